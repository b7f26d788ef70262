"""``python -m tests.soak.load KIND ENDPOINT``: one kind of load of a soak, until it is killed.

Prints a line with its counters every few seconds.
"""

from __future__ import annotations

import itertools
import json
import random
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Callable

from tests.fuzz.seeds import Mutator
from tests.support import messages
from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf_client import Broadcaster, Transaction, TransformClient

_REPORT_S = 2.0
_LIVE_FRAMES = 50
_counts: Counter[str] = Counter()


def _link(parent: str, child: str) -> StampedTransform:
    return StampedTransform(parent, child, time.time_ns(), Transform((random.random(), 0, 0)))


def churn(endpoint: str) -> Callable[[], object]:
    """Frames with names that never come back are made and removed."""
    tf = TransformClient.connect(endpoint, timeout_s=20.0, reads="query")
    live: deque[str] = deque()
    number = itertools.count()

    def step() -> None:
        name = f"churned {next(number)}"
        tf.set_transform(_link("world", name))
        live.append(name)
        if len(live) > _LIVE_FRAMES:
            tf.remove_frame(live.popleft())
        time.sleep(0.01)

    return step


def sensors(endpoint: str) -> Callable[[], object]:
    """Ten sensors of 50 Hz, each with its own connection, as in a process of its own; one after
    another is replaced by one with a new name, until the server knows no more names."""
    number = itertools.count()

    def connect() -> tuple[TransformClient, Broadcaster]:
        tf = TransformClient.connect(endpoint, timeout_s=20.0, reads="query")
        return tf, tf.broadcaster(f"sensor {next(number)}")

    running = deque(connect() for _ in range(10))

    def step() -> None:
        for index, (_, sensor) in enumerate(running):
            sensor.send(_link("world", f"sensed {index}"))
        if random.random() < 0.1:
            running.popleft()[0].close()
            running.append(connect())
        time.sleep(0.02)

    return step


def statics(endpoint: str) -> Callable[[], object]:
    """A driver announces its static links again and again, with other values."""
    tf = TransformClient.connect(endpoint, timeout_s=20.0, reads="query")
    driver = tf.broadcaster("driver")

    def step() -> None:
        driver.send_static([_link("world", f"fixed {index}") for index in range(20)])
        time.sleep(0.2)

    return step


def transactions(endpoint: str) -> Callable[[], object]:
    """Two clients' worth of read-modify-write, and lookups that wait in vain."""
    tf = TransformClient.connect(endpoint, timeout_s=20.0, reads="query")
    tf.set_transform(_link("world", "counter"))

    def add(tx: Transaction) -> None:
        x = tx.lookup_latest_transform_xact("world", "counter").transform.translation[0]
        now_ns = time.time_ns()
        tx.set_transform(StampedTransform("world", "counter", now_ns, Transform((x + 1, 0, 0))))

    def step() -> None:
        tf.run_transaction(add)
        tf.lookup_transforms("world", "counter", [time.time_ns()] * 100)
        tf.can_transform("world", "never", timeout_s=0.01)
        time.sleep(0.005)

    return step


_GUEST = """
import sys, time
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient
tf = TransformClient.connect(sys.argv[1], reads="query")
now_ns = time.time_ns()
sensor = tf.broadcaster(f"guest {now_ns}")
sensor.send(StampedTransform("world", "guest", now_ns, Transform((1, 0, 0))))
print(len(tf.frames()), flush=True)
try:
    tf.lookup_transform("world", "never", timeout_s=float(sys.argv[2]))
except Exception:
    pass
"""


def guests(endpoint: str) -> Callable[[], object]:
    """Clients that come and go: some close, some just end, some are killed while they wait. Those
    that do not close publish under names that never come back."""

    def step() -> None:
        with TransformClient.connect(endpoint, timeout_s=20.0, reads="query") as tf:
            tf.can_transform("world", "counter")
        wait_s = random.choice(("0.05", "100"))
        command = [sys.executable, "-c", _GUEST, endpoint, wait_s]
        guest = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert guest.stdout is not None
        guest.stdout.readline()
        time.sleep(0.2)
        guest.kill()
        guest.communicate()
        _counts["killed"] += 1

    return step


def strangers(endpoint: str) -> Callable[[], object]:
    """Damaged messages, which must leave nothing behind."""
    mutator = Mutator(0)
    closing = messages.session(endpoint)
    opened = closing.__enter__()

    def step(_: object = closing) -> None:  # holds the session open
        request_type, payload = mutator.next()
        if request_type not in ("admin", "set", "static"):  # a reset would end the other loads
            messages.send(opened, request_type, payload, 20.0)
        time.sleep(0.02)

    return step


KINDS = (churn, sensors, statics, transactions, guests, strangers)


def main() -> None:
    name, endpoint = sys.argv[1:]
    step = {kind.__name__: kind for kind in KINDS}[name](endpoint)
    print("ready", flush=True)
    next_s = 0.0
    while True:
        try:
            step()
            _counts["ok"] += 1
        except TransformException as error:
            _counts[type(error).__name__] += 1
            time.sleep(0.05)
        if time.monotonic() > next_s:
            print(json.dumps(_counts), flush=True)
            next_s = time.monotonic() + _REPORT_S


if __name__ == "__main__":
    main()
