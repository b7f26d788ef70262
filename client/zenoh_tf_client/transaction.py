"""Read-modify-write: strictly serializable, with no lock held across the network.

    def move(tx):
        gripper = tx.lookup_latest_transform_xact("map", "gripper")
        tx.set_transform(StampedTransform("map", "object", now, gripper.transform))

    tf.run_transaction(move)

Reads remember the versions that they saw; sets are kept back and committed by one query,
which the server accepts only if those versions still stand. `run_transaction` tries again
on a conflict; ``with tf.transaction() as tx:`` tries once and raises TransactionConflict.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, TypeVar

import numpy as np

from zenoh_tf import LatestTransform, StampedTransform, wire
from zenoh_tf.errors import (
    InvalidArgumentException,
    ServerRestarted,
    TransactionConflict,
)

from . import columns, requests
from .connection import Connection
from .requests import Request

T = TypeVar("T")

#: Pauses between attempts: random up to a bound that doubles, so that rivals part.
FIRST_PAUSE_S = 0.001
LONGEST_PAUSE_S = 0.1


class Transaction:
    """One attempt. Its reads do not see its own sets. Not for several threads."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._instance: str | None = None
        self._versions: dict[str, int] = {}
        self._reads = 0
        self._sets: list[StampedTransform] = []
        self._kind: tuple[str, bool] | None = None  # authority, static: one of each per commit

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.commit()

    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None
    ) -> StampedTransform:
        return self._read(requests.lookup_transform(target, source, stamp_ns))

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
    ) -> StampedTransform:
        return self._read(
            requests.lookup_transform_full(
                target, target_stamp_ns, source, source_stamp_ns, fixed_frame
            )
        )

    def can_transform(self, target: str, source: str, stamp_ns: int | None = None) -> bool:
        return self._read(requests.can_transform(target, source, stamp_ns))

    def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform:
        return self._read(requests.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]:
        return self._read(requests.lookup_latest_transforms_xact(pairs))

    def latest_common_time(self, a: str, b: str) -> int | None:
        return self._read(requests.latest_common_time(a, b))

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> None:
        self.set_transforms_xact([stamped], authority, static)

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None:
        """Add to what the commit writes, all or nothing."""
        if self._kind not in (None, (authority, static)):
            raise InvalidArgumentException(
                "one transaction writes with one authority, either static or not",
                field="static" if self._kind and self._kind[1] != static else "authority",
            )
        self._kind = (authority, static)
        self._sets.extend(stampeds)

    def commit(self) -> None:
        """Commit the sets, if everything read still stands.

        Raises TransactionConflict, ServerRestarted, OutcomeUnknown, or why the tree refuses.
        """
        # A single read is one snapshot already; several were taken at different times.
        if not self._sets and self._reads <= 1:
            return
        authority, static = self._kind or ("", False)
        commit = columns.commit(self._sets, authority, static)
        commit.read_names = list(self._versions)
        commit.read_versions = np.fromiter(self._versions.values(), np.uint64, len(self._versions))
        reply = self._connection.write("commit", wire.commit_body(commit), self._instance)
        wire.parse_commit_reply(reply, commit.rows)

    def _read(self, request: Request[T]) -> T:
        reply = self._connection.read("lookup", request.body() | {"versions": True})
        instance = wire.text(reply, "instance")
        if self._instance not in (None, instance):
            raise ServerRestarted(
                f"this transaction read from server instance {self._instance}, "
                f"now {instance} serves",
                value=instance,
            )
        self._instance = instance
        self._reads += 1
        for name, version in wire.parse_read_set(reply):
            if self._versions.setdefault(name, version) != version:
                raise TransactionConflict(
                    f"frame {name!r} changed between two reads of the transaction", frame=name
                )
        return request.parse(reply)


def run_transaction(
    connection: Connection, function: Callable[[Transaction], T], attempts: int
) -> T:
    """Call `function` with a fresh transaction and commit, again on a conflict."""
    if attempts < 1:
        raise InvalidArgumentException("attempts must be at least 1", field="attempts")
    longest_s = FIRST_PAUSE_S
    attempt = 1
    while True:
        try:
            with Transaction(connection) as transaction:
                result = function(transaction)
            return result
        except TransactionConflict as conflict:
            if attempt == attempts:
                conflict.add_note(f"in each of {attempts} attempts")
                raise
        attempt += 1
        time.sleep(random.uniform(0, longest_s))
        longest_s = min(2 * longest_s, LONGEST_PAUSE_S)
