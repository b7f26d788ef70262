"""``python -m tests.chaos.client ENDPOINT SLOT START_S SEED FILE KIND``: runs transactions.

KIND says how they read: ``query``, ``shared`` (the server's memory, and queries where that does
not answer) or ``mirror``; a ``follower`` reads a mirror without asking the server whether it is
current, a ``replica`` client has two endpoints, of the server and of its replica, and a ``blind``
client does not read.

Writes a line of JSON to FILE before each transaction and one after it, so that a client that is
killed leaves its open call in the file.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from zenoh_tf import LatestTransform, TransformException
from zenoh_tf.errors import OutcomeUnknown, TransactionConflict
from zenoh_tf_client import Mirror, Transaction, TransformClient
from zenoh_tf_client.requests.receipt import Receipt

from . import links

#: Calls give up after this. A server is stopped, and a network held, for longer and for shorter.
TIMEOUT_S = 0.7
#: Clients with different slots write different versions.
SLOTS = 16
#: One of so many transactions has a stamp of a clock that is wrong by so much.
_WRONG_CLOCK = 50
_WRONG_MS = 300


class Client:
    reads: Literal["shared", "query"] = "query"
    #: Whether each read is of a time between its call and its return, also without a commit.
    _reads_now = True

    def __init__(self, endpoint: str, slot: int, start_s: float, seed: str, path: str) -> None:
        self._endpoint = endpoint
        self._path = path
        self._slot = slot
        self._start_s = start_s
        self._random = random.Random(seed)
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._last_ms = 0
        self._used: set[int] = set()
        self._is_over = False  # another client begins

    def run(self) -> None:
        """Run transactions until the process is killed."""
        while True:
            try:
                tf = TransformClient.connect(self._endpoint, timeout_s=TIMEOUT_S, reads=self.reads)
            except TransformException:  # no server now
                time.sleep(0.1)
                continue
            with tf:
                self._prepare(tf)
                while not self._is_over:
                    if self._step(tf).startswith("failed"):
                        time.sleep(0.02)  # no server, or one that is still empty
            self._is_over = False

    def _prepare(self, tf: TransformClient) -> None:
        """Do what comes before the first transaction."""

    def _attempt(self, tf: TransformClient, body: Callable[[Transaction], None]) -> str:
        """Run one transaction. Returns the kind of read that it could use."""
        kind = tf.reads
        with tf.transaction() as transaction:
            body(transaction)
        return kind

    def _write(self, **record: Any) -> None:
        os.write(self._file, json.dumps(record).encode() + b"\n")

    def _version(self) -> int:
        """A version of this client's own, in the order of time but for wrong clocks."""
        now_ms = int(1e3 * (time.monotonic() - self._start_s))
        self._last_ms = now_ms = max(self._last_ms + 1, now_ms)
        if self._random.randrange(_WRONG_CLOCK) == 0:
            now_ms = max(1, now_ms + self._random.randint(-_WRONG_MS, _WRONG_MS))
        version = now_ms * SLOTS + self._slot
        while version in self._used:
            version += SLOTS
        self._used.add(version)
        assert version < links.LAST_VERSION, "the run is too long for its versions"
        return version

    def _step(self, tf: TransformClient) -> str:
        return self._transaction(tf)

    def _transaction(self, tf: TransformClient) -> str:
        writes = self._random.random() < 0.6
        ends = self._random.choices(list(links.CHAINS), k=self._random.choice((1, 1, 2)))
        written = self._random.sample(range(links.LINKS), self._random.choice((1, 2, 3)))
        version = self._version() if writes else 0
        self._write(invoked=time.monotonic_ns(), version=version, written=written if writes else [])
        reads: list[tuple[int, int, links.Seen]] = []

        def body(transaction: Transaction) -> None:
            for end in ends:
                before_ns = time.monotonic_ns()
                found = transaction.lookup_latest_transform_xact("root", f"link{end}")
                seen = links.decode(end, found.transform)
                reads.append((before_ns, time.monotonic_ns(), seen))
            if writes:
                transaction.set_transforms_xact(links.rows(written, version))

        outcome, kind = "committed", ""
        try:
            kind = self._attempt(tf, body)
        except TransactionConflict:
            outcome = "conflict"
        except OutcomeUnknown:
            outcome = "unknown"
        except TransformException as error:
            outcome = f"failed: {type(error).__name__}"  # it did not run
        except ValueError as error:
            outcome = f"inconsistent: {error}"
        if outcome != "committed" and not self._reads_now:
            reads.clear()
        after_ns, is_copy = time.monotonic_ns(), kind == "replica" and not writes
        self._write(responded=after_ns, outcome=outcome, reads=reads, kind=kind, is_copy=is_copy)
        return outcome


class SharedClient(Client):
    """Reads the server's memory, and asks by query where that gives no answer.

    Its requests go through the server's socket, past the proxy and its faults. It pauses, so that
    the others, which are slower, have their part in the history.
    """

    reads = "shared"

    def _step(self, tf: TransformClient) -> str:
        time.sleep(self._random.uniform(0, 0.01))
        return super()._step(tf)


class MirrorClient(Client):
    """Reads a mirror. What it reads may be old, and is compared when the transaction commits."""

    _reads_now = False
    _mirror: Mirror

    def _prepare(self, tf: TransformClient) -> None:
        while True:
            try:
                self._mirror = tf.mirror()
                return
            except TransformException:
                time.sleep(0.1)

    def _attempt(self, tf: TransformClient, body: Callable[[Transaction], None]) -> str:
        self._mirror.run_transaction(body, attempts=1)
        return "mirror"


class FollowerClient(MirrorClient):
    """Reads a mirror by itself, and waits there for what it has written.

    What it reads may be old, but must be the result of the first commits of the server's order,
    each as a whole; never go back; and show its own writes.
    """

    _PAUSE_S = 0.01
    _WAIT_S = 5.0

    def _step(self, tf: TransformClient) -> str:
        time.sleep(self._random.uniform(0, self._PAUSE_S))
        return self._write_and_wait(tf) if self._random.random() < 0.2 else self._look(tf)

    def _read(
        self, tf: TransformClient, pairs: list[tuple[str, str]]
    ) -> tuple[list[LatestTransform], str]:
        """Look up together; return the kind of read as well."""
        return self._mirror.lookup_latest_transforms_xact(pairs), "follower"

    def _wait(self, tf: TransformClient) -> None:
        """Wait until reads show the last write. Raises if that is not known."""
        self._mirror.wait_for(tf.last_receipt, self._WAIT_S)

    def _look(self, tf: TransformClient) -> str:
        ends = self._random.sample(list(links.CHAINS), k=2)
        before_ns = time.monotonic_ns()
        self._write(invoked=before_ns, version=0, written=[])
        reads: list[tuple[int, int, links.Seen]] = []
        outcome, kind = "committed", ""
        try:
            found, kind = self._read(tf, [("root", f"link{end}") for end in ends])
            after_ns = time.monotonic_ns()
            for end, one in zip(ends, found, strict=True):
                reads.append((before_ns, after_ns, links.decode(end, one.transform)))
        except TransformException as error:
            outcome = f"failed: {type(error).__name__}"
        except ValueError as error:
            outcome = f"inconsistent: {error}"
        after_ns = time.monotonic_ns()
        self._write(responded=after_ns, outcome=outcome, reads=reads, kind=kind, is_copy=True)
        return outcome

    def _write_and_wait(self, tf: TransformClient) -> str:
        written = self._random.sample(range(links.LINKS), self._random.choice((1, 2, 3)))
        version = self._version()
        self._write(invoked=time.monotonic_ns(), version=version, written=written)
        outcome, waited = "committed", False
        try:
            tf.set_transforms_xact(links.rows(written, version))
        except OutcomeUnknown:
            outcome = "unknown"
        except TransformException as error:
            outcome = f"failed: {type(error).__name__}"
        responded_ns = time.monotonic_ns()
        if outcome == "committed":
            with contextlib.suppress(TransformException):  # another server, or a broken link
                self._wait(tf)
                waited = True
        self._write(responded=responded_ns, outcome=outcome, reads=[], waited=waited)
        return outcome


class ReplicaClient(FollowerClient):
    """Is at the server or at its replica. Half of its reads are parts of transactions.

    What it reads at a replica may be old, as in a mirror. At a replica it cannot write: then it
    connects again, and what it has seen goes with it, as to its next process. Before that it reads
    some times there, as a visit is rare.
    """

    _READS_A_VISIT = 20
    _tf: TransformClient | None = None

    def _prepare(self, tf: TransformClient) -> None:
        self._tf = tf
        lines = Path(self._path).read_text().splitlines()
        seen = next(
            (json.loads(line)["seen"] for line in reversed(lines) if '"seen"' in line), None
        )
        if seen is not None:
            tf._connection.floor.value = Receipt(*seen)

    def _write(self, **record: Any) -> None:
        if "outcome" in record:
            assert self._tf is not None
            record["seen"] = self._tf._connection.floor.value
        super()._write(**record)

    def _step(self, tf: TransformClient) -> str:
        if _asked(tf) == "replica" and self._random.randrange(self._READS_A_VISIT):
            return self._look(tf)
        outcome = self._transaction(tf) if self._random.random() < 0.5 else super()._step(tf)
        self._is_over = outcome == "failed: ReadOnlyReplica"
        return outcome

    def _attempt(self, tf: TransformClient, body: Callable[[Transaction], None]) -> str:
        with tf.transaction() as transaction:
            body(transaction)
        return _asked(tf)

    def _read(
        self, tf: TransformClient, pairs: list[tuple[str, str]]
    ) -> tuple[list[LatestTransform], str]:
        return tf.lookup_latest_transforms_xact(pairs), _asked(tf)

    def _wait(self, tf: TransformClient) -> None:
        """The replica does."""


def _asked(tf: TransformClient) -> str:
    """Who gave the last answer."""
    return "query" if tf.age_s is None else "replica"


class BlindClient(Client):
    """Writes one link and reads nothing, so that no read set keeps a late write from running.

    Its stamps are ahead, so that a write that is applied late is still the newest. After an
    unknown outcome it pauses, so that no later write of its own hides that one.
    """

    _AHEAD_MS = 2500
    _LINK = links.LINKS - 1
    _PAUSE_S = 1.5

    def _step(self, tf: TransformClient) -> str:
        version = self._version() + self._AHEAD_MS * SLOTS
        self._write(invoked=time.monotonic_ns(), version=version, written=[self._LINK])
        outcome = "committed"
        try:
            tf.set_transforms_xact(links.rows([self._LINK], version))
        except OutcomeUnknown:
            outcome = "unknown"
        except TransformException as error:
            outcome = f"failed: {type(error).__name__}"
        self._write(responded=time.monotonic_ns(), outcome=outcome, reads=[])
        if outcome == "unknown":
            time.sleep(self._PAUSE_S)
        return outcome


KINDS: dict[str, type[Client]] = {
    "query": Client,
    "shared": SharedClient,
    "mirror": MirrorClient,
    "follower": FollowerClient,
    "replica": ReplicaClient,
    "blind": BlindClient,
}


def main() -> None:
    endpoint, slot, start, seed, path, kind = sys.argv[1:]
    KINDS[kind](endpoint, int(slot), float(start), seed, path).run()


if __name__ == "__main__":
    main()
