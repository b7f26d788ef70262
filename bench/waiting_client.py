"""A client process with many waiting lookups: ``ENDPOINT KIND FIRST COUNT STAMP_NS``.

KIND ``single``: each lookup is a query of its own, all of them open at once. ``batch``: threads
send them in batches. Prints a line when all are sent, then one JSON line: for each lookup when its
answer came (this machine's monotonic clock) and how many answers came.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import zenoh

from bench.processes import open_session
from bench.waiting import BATCH, TIMEOUT_S, TREE, frame
from zenoh_tf import keys, wire
from zenoh_tf_client import TransformClient, requests
from zenoh_tf_client.requests import Request


class Answers:
    """Which came, and when."""

    def __init__(self, indexes: Iterable[int]) -> None:
        self.times_ns: dict[int, list[int]] = {index: [] for index in indexes}
        self._left = len(self.times_ns)
        self._lock = threading.Lock()
        self.complete = threading.Event()

    def came(self, index: int) -> None:
        with self._lock:
            self.times_ns[index].append(time.monotonic_ns())
            self._left -= len(self.times_ns[index]) == 1
            if self._left == 0:
                self.complete.set()


def send_single(endpoint: str, stamp_ns: int, answers: Answers) -> Callable[[], None]:
    session = open_session(endpoint)
    key = keys.operation(TREE, "lookup")
    for index in answers.times_ns:
        request = requests.lookup_transform("map", frame(index), stamp_ns, TIMEOUT_S)

        def on_reply(
            reply: zenoh.Reply, index: int = index, request: Request[Any] = request
        ) -> None:
            if (sample := reply.ok) is not None:
                request.parse(wire.unpack(sample.payload.to_bytes()))
                answers.came(index)

        session.get(
            key,
            on_reply,
            payload=wire.pack(request.body()),
            timeout=2 * TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
    return session.close


def send_batches(endpoint: str, stamp_ns: int, answers: Answers) -> Callable[[], None]:
    tf = TransformClient.connect(endpoint, TREE, timeout_s=30.0)
    indexes = list(answers.times_ns)

    def wait_for(part: list[int]) -> None:
        with tf.batch() as batch:
            handles = [
                batch.lookup_transform("map", frame(index), stamp_ns, timeout_s=TIMEOUT_S)
                for index in part
            ]
        for index, handle in zip(part, handles, strict=True):
            handle.result()
            answers.came(index)

    for at in range(0, len(indexes), BATCH):
        threading.Thread(target=wait_for, args=(indexes[at : at + BATCH],)).start()
    return tf.close


def main() -> None:
    endpoint, kind, first, count, stamp_ns = sys.argv[1:]
    answers = Answers(range(int(first), int(first) + int(count)))
    send = send_single if kind == "single" else send_batches
    close = send(endpoint, int(stamp_ns), answers)
    print("sent", flush=True)
    answers.complete.wait(TIMEOUT_S)
    time.sleep(0.5)  # would a second answer come?
    print(json.dumps(answers.times_ns), flush=True)
    close()


if __name__ == "__main__":
    main()
