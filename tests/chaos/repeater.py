"""``python -m tests.chaos.repeater ENDPOINT SLOT START_S SEED FILE DIRECT``: repeats writes.

Sends each commit three times under one id: over a connection with faults, and twice over a direct
one. All replies must be the same, and the commit must run once. Its read set holds what it writes,
so that a second run would be a conflict.
"""

from __future__ import annotations

import os
import sys
import time
from typing import NamedTuple

import numpy as np
import zenoh

from tests.support import messages
from zenoh_tf import Transform, wire
from zenoh_tf.errors import (
    ServerBusy,
    ServerRestarted,
    TimeoutException,
    TransactionConflict,
    TransformException,
)

from . import links
from .client import TIMEOUT_S, Client

#: A repeat with one of these errors says nothing about the first run.
_NOT_THE_FIRST = (ServerRestarted, TimeoutException, ServerBusy)


class _Reply(NamedTuple):
    data: bytes
    error: TransformException | None


class Repeater(Client):
    def __init__(
        self, endpoint: str, slot: int, start_s: float, seed: str, path: str, direct: str
    ) -> None:
        super().__init__(endpoint, slot, start_s, seed, path)
        self._direct = direct

    def run(self) -> None:
        while True:
            try:
                with (
                    messages.session(self._endpoint, TIMEOUT_S) as faulty,
                    messages.session(self._direct, TIMEOUT_S) as direct,
                ):
                    while True:
                        if self._repeat(faulty, direct).startswith(("failed", "unknown")):
                            time.sleep(0.05)
            except zenoh.ZError:  # no server now
                time.sleep(0.1)

    def _repeat(self, faulty: zenoh.Session, direct: zenoh.Session) -> str:
        version, end = self._version(), self._random.choice(list(links.CHAINS))
        written = list(links.CHAINS[end])
        self._write(invoked=time.monotonic_ns(), version=version, written=written)
        outcome, reads = "", []
        try:
            before_ns = time.monotonic_ns()
            seen, payload = self._commit(direct, end, written, version)
            reads.append((before_ns, time.monotonic_ns(), seen))
        except (TransformException, LookupError, zenoh.ZError) as error:
            outcome = f"failed: {type(error).__name__}"  # no server, or one that is still empty
        except ValueError as error:
            outcome = f"inconsistent: {error}"
        else:
            outcome = self._send_all([faulty, direct, direct], payload)
        self._write(responded=time.monotonic_ns(), outcome=outcome, reads=reads)
        return outcome

    def _commit(
        self, direct: zenoh.Session, end: int, written: list[int], version: int
    ) -> tuple[links.Seen, bytes]:
        """A read, and the payload of a commit that depends on it."""
        hello = self._reply(direct, "hello", messages.pack({"v": 1, "what": "hello"}))
        if hello.error:
            raise hello.error
        server = wire.unpack(hello.data)["value"]
        body = messages.same_lookup(1, "root", f"link{end}", op=wire.OP_LATEST_XACT, versions=True)
        found = self._reply(direct, "lookup", messages.pack(body))
        if found.error:
            raise found.error
        reply = wire.unpack(found.data)
        if reply["instance"] != server["instance"]:
            raise ServerRestarted("between two requests")
        error, _, _, pose, _ = next(wire.parse_lookup_reply(reply, 1).rows())
        if error:
            raise error
        seen = links.decode(end, Transform(pose[:3], pose[3:]))
        stampeds = links.rows(written, version)
        names = ["epoch", *(f"link{link}" for link in range(links.LINKS))]
        commit = messages.commit(
            names,
            [names.index(each.parent_frame) for each in stampeds],
            [names.index(each.child_frame) for each in stampeds],
            version,
        )
        commit["pose"] = np.array([each.transform.pose() for each in stampeds], "<f8").tobytes()
        expires_ns = server["clock_ns"] + int(TIMEOUT_S * 1e9)
        write = wire.write_fields(os.urandom(16), expires_ns, server["instance"])
        read_set = {name: reply[name] for name in ("read_names", "read_versions")}
        return seen, messages.pack({**commit, **read_set, **write})

    def _send_all(self, sessions: list[zenoh.Session], payload: bytes) -> str:
        decisive: list[_Reply] = []
        for session in sessions:
            try:
                reply = self._reply(session, "commit", payload)
            except (LookupError, zenoh.ZError):  # no reply
                continue
            if not isinstance(reply.error, _NOT_THE_FIRST):
                decisive.append(reply)
        if not decisive:
            return "unknown"
        if len({reply.data for reply in decisive}) > 1:
            return "inconsistent: a repeat got another reply than the first"
        error = decisive[0].error
        if error is None:
            return "committed"
        kind = type(error).__name__
        return "conflict" if isinstance(error, TransactionConflict) else f"failed: {kind}"

    @staticmethod
    def _reply(session: zenoh.Session, request_type: str, payload: bytes) -> _Reply:
        """The reply to a query. Raises LookupError if there is none."""
        data, failed = messages.send(session, request_type, payload, TIMEOUT_S / 2)
        if not data or data == b"Timeout":
            raise LookupError("no reply")
        return _Reply(data, wire.decode_error(wire.unpack(data)["error"]) if failed else None)


def main() -> None:
    endpoint, slot, start, seed, path, direct = sys.argv[1:]
    Repeater(endpoint, int(slot), float(start), seed, path, direct).run()


if __name__ == "__main__":
    main()
