"""`Mirror`: a copy of the server's tree in this process, kept up to date by its stream."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from zenoh_tf import LatestTransform, StampedTransform, wire
from zenoh_tf._zenoh.calls import raise_if_forked

from ..requests import lookups
from ..requests.receipt import Receipt
from ..requests.request import Request
from ..session.connection import Connection
from ..session.mapped_tree import MappedTree
from ..transaction import Transaction, repeat
from .base_mirror import BaseMirror
from .transaction import MirrorTransaction

if TYPE_CHECKING:
    from typing_extensions import Self

    from zenoh_tf import Dropped
    from zenoh_tf.gates.gate import Gate

T = TypeVar("T")


class Mirror(BaseMirror):
    """A copy of the server's tree in this process; made by `TransformClient.mirror`.

    Its lookups are as fast as those of an embedded tree, and send no message. What they read is
    always a state that the server's tree has had: the commits up to `seq`, each as a whole, and
    none after it. `age_s` says how old that state may be. Several lookups may see several such
    states, but never go back while the same server runs. Writes go to the server, as always.

    While the server is away, or the link is cut, the last state is served and its age grows.
    The contract: docs/how-to/mirrors.md. A context manager, which closes itself at the end.

    Thread safety: all methods.

    Example:
        ``with tf.mirror() as m: print(m.lookup_transform("map", "base"), m.age_s)``
    """

    def __init__(
        self,
        connection: Connection,
        mapped: MappedTree,
        timeout_s: float,
        interest: wire.Interest | None,
    ) -> None:
        """Use `TransformClient.mirror` instead."""
        super().__init__(connection, timeout_s, interest)
        self._connection = connection
        self._mapped = mapped

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop following the server. Lookups then raise ServerUnavailable. May be called again."""
        self._end()

    def wait_for(self, receipt: Receipt | None = None, timeout_s: float = 5.0) -> None:
        """Wait until what a client has written can be read here.

        Args:
            receipt: Its `last_receipt` after the write, also of another process; None for all that
                this mirror's own client has written so far.
            timeout_s: How long to wait, in seconds.

        Raises:
            TimeoutException: The mirror has not received it in time.
            ServerRestarted: It was written to another server instance than the mirror follows.
            ServerUnavailable: The mirror is closed.

        Example:
            ``tf.set_transform(stamped); m.wait_for()``
        """
        raise_if_forked()
        awaited = receipt or self._connection.last_receipt
        if awaited is not None and not self._has(awaited):
            self._wait_until(awaited, timeout_s)

    # --- lookups that may wait

    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform`."""
        return self._tree.lookup_transform(target, source, stamp_ns, timeout_s, max_gap_s=max_gap_s)

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform_full`."""
        frames = (target, target_stamp_ns, source, source_stamp_ns, fixed_frame)
        return self._tree.lookup_transform_full(*frames, timeout_s, max_gap_s=max_gap_s)

    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool:
        """As `TransformTree.can_transform`."""
        return self._tree.can_transform(target, source, stamp_ns, timeout_s)

    # --- lookups that may ask the server

    def lookup_latest_transform(
        self, target: str, source: str, max_age_s: float | None = None
    ) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform`, or by query.

        Args:
            max_age_s: How old the mirror's state may be, in seconds; if it is older, the server is
                asked. None for any age.

        Raises:
            ServerUnavailable: The mirror is closed, or the server was asked and did not answer.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return (self._current or self._tree).lookup_latest_transform(target, source)
        return self._ask(lookups.lookup_latest_transform(target, source))

    def lookup_latest_transform_xact(
        self, target: str, source: str, max_age_s: float | None = None
    ) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform_xact`, or by query.

        Args:
            max_age_s: As for `lookup_latest_transform`, in seconds.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return (self._current or self._tree).lookup_latest_transform_xact(target, source)
        return self._ask(lookups.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]], max_age_s: float | None = None
    ) -> list[LatestTransform]:
        """As `TransformTree.lookup_latest_transforms_xact`, or by query.

        Args:
            max_age_s: As for `lookup_latest_transform`, in seconds.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return self._tree.lookup_latest_transforms_xact(pairs)
        return self._ask(lookups.lookup_latest_transforms_xact(pairs))

    def gate(
        self,
        target: str,
        *,
        queue_size: int = 100,
        timeout_s: float = 1.0,
        on_drop: Callable[[Dropped[Any]], object] | None = None,
        max_gap_s: float | None = None,
    ) -> Gate:
        """As `TransformTree.gate`: make a gate, which looks up in the mirror.

        Example:
            ``with m.gate("map") as gate: gate.put(image, "camera", stamp_ns)``
        """
        from zenoh_tf.gates.gate import Gate  # noqa: PLC0415 - most programs need none

        return Gate(self, target, queue_size, timeout_s, on_drop, max_gap_s)

    def run_transaction(self, function: Callable[[Transaction], T], attempts: int = 10) -> T:
        """As `TransformClient.run_transaction`, with reads in the mirror: one round trip.

        The server compares what was read with its own state, so the transaction is strictly
        serializable, however old the mirror is. A read waits for what this mirror's transactions
        have written to the same frames; after a conflict, the next attempt waits for the state that
        the last one was in conflict with.

        Example:
            ``m.run_transaction(lift)``
        """
        raise_if_forked()

        def begin(attempt: int) -> Transaction:
            return MirrorTransaction(self._connection, self._mapped, self, attempt)

        return repeat(begin, function, attempts)

    def _ask(self, request: Request[T]) -> T:
        raise_if_forked()
        return self._connection.call(request)
