"""`AsyncMirror`: a copy of the server's tree, for asyncio."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import (
    Explanation,
    FrameInfo,
    LatestTransform,
    StampedTransform,
    TransformArray,
    Velocity,
    wire,
)

from ..mirror.mirror import Mirror
from ..requests.receipt import Receipt
from .mirror_transaction import AsyncMirrorTransaction
from .session.connection import Connection
from .session.shared_reads import SharedReads
from .session.threads import in_thread
from .transaction import AsyncTransaction, repeat

T = TypeVar("T")


async def make_mirror(
    connection: Connection, interest: wire.Interest | None, timeout_s: float
) -> Mirror:
    """Make the mirror that an `AsyncMirror` or `AsyncWatch` reads."""
    return await in_thread(
        lambda: Mirror(connection.opened, connection.mapped, timeout_s, interest),
        undo=lambda mirror: mirror.close(),
    )


class AsyncMirror:
    """A copy of the server's tree in this process; made by `AsyncTransformClient.mirror`.

    Its lookups are no coroutines: they answer from memory, without suspending the caller, and do
    not wait for a transform. They read what those of `Mirror` read. `age_s` tells how old that may
    be: if it is too old for you, ask the server by the methods of `AsyncTransformClient`. An
    asynchronous context manager, which closes itself at the end. docs/mirrors.md has the contract.

    Concurrency: lookups and properties, from any thread; coroutines, from the client's event loop.

    Example:
        ``async with await tf.mirror() as m: print(m.lookup_transform("map", "base"), m.age_s)``
    """

    def __init__(self, connection: Connection, reads: SharedReads, mirror: Mirror) -> None:
        """Use `AsyncTransformClient.mirror` instead.

        Args:
            connection: The connection to the server.
            reads: How transactions read that do not read here.
            mirror: The copy.
        """
        self._connection = connection
        self._reads = reads
        self._mirror = mirror

    def __repr__(self) -> str:
        return f"<Async{repr(self._mirror)[1:]}"

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Stop following the server. Lookups then raise ServerUnavailable. May be called again."""
        await in_thread(self._mirror.close, undo=lambda _: None)

    @property
    def age_s(self) -> float:
        """Returns how old what is read may be, in seconds; see `Mirror.age_s`."""
        return self._mirror.age_s

    @property
    def seq(self) -> int:
        """Returns the number of a commit: it and all before it can be read."""
        return self._mirror.seq

    @property
    def synced(self) -> bool:
        """Returns True if the mirror knows of nothing that it lacks."""
        return self._mirror.synced

    @property
    def instance(self) -> str:
        """Returns the id of the server instance whose state is read."""
        return self._mirror.instance

    async def wait_for(self, receipt: Receipt | None = None, timeout_s: float = 5.0) -> None:
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
            ``await tf.set_transform(stamped); await m.wait_for()``
        """
        awaited = receipt or self._connection.last_receipt
        if awaited is None or self._mirror._feed.state.has(awaited.instance, awaited.seq):
            return
        mirror = self._mirror
        await in_thread(lambda: mirror.wait_for(awaited, timeout_s), undo=lambda _: None)

    async def run_transaction(
        self, function: Callable[[AsyncTransaction], Awaitable[T]], attempts: int = 10
    ) -> T:
        """As `AsyncTransformClient.run_transaction`, with reads in the mirror: one round trip.

        Args:
            function: A coroutine function that reads and sets through the transaction. It may be
                called several times.
            attempts: How often to call it at most.

        Returns:
            What `function` returned in the attempt that was committed.

        Raises:
            TransactionConflict: Others changed what was read, in every attempt.
            TransformException: `function` or the commit failed; see `AsyncTransaction.commit`.

        Example:
            ``await m.run_transaction(lift)``
        """
        attempt = 0

        def begin() -> AsyncTransaction:
            nonlocal attempt
            attempt += 1
            return AsyncMirrorTransaction(self._connection, self._reads, self._mirror, attempt)

        return await repeat(begin, function, attempts)

    # --- lookups

    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None
    ) -> StampedTransform:
        """As `Mirror.lookup_transform`."""
        return self._mirror.lookup_transform(target, source, stamp_ns)

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
    ) -> StampedTransform:
        """As `Mirror.lookup_transform_full`."""
        return self._mirror.lookup_transform_full(
            target, target_stamp_ns, source, source_stamp_ns, fixed_frame
        )

    def can_transform(self, target: str, source: str, stamp_ns: int | None = None) -> bool:
        """As `Mirror.can_transform`."""
        return self._mirror.can_transform(target, source, stamp_ns)

    def lookup_latest_transform(self, target: str, source: str) -> LatestTransform:
        """As `Mirror.lookup_latest_transform`, at any age."""
        return self._mirror.lookup_latest_transform(target, source)

    def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform:
        """As `Mirror.lookup_latest_transform_xact`, at any age."""
        return self._mirror.lookup_latest_transform_xact(target, source)

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]:
        """As `Mirror.lookup_latest_transforms_xact`, at any age."""
        return self._mirror.lookup_latest_transforms_xact(pairs)

    def latest_common_time(self, a: str, b: str) -> int | None:
        """As `Mirror.latest_common_time`."""
        return self._mirror.latest_common_time(a, b)

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: int | Sequence[int] | NDArray[np.integer[Any]] | None,
    ) -> TransformArray:
        """As `Mirror.lookup_transforms`."""
        return self._mirror.lookup_transforms(targets, sources, stamps_ns)

    def sample(
        self, target: str, source: str, stamps_ns: Sequence[int] | NDArray[np.integer[Any]]
    ) -> TransformArray:
        """As `Mirror.sample`."""
        return self._mirror.sample(target, source, stamps_ns)

    def deskew(
        self,
        points: ArrayLike,
        stamps_ns: ArrayLike,
        source: str,
        fixed_frame: str,
        at_ns: int,
        *,
        out: NDArray[Any] | None = None,
    ) -> NDArray[Any]:
        """As `Mirror.deskew`."""
        return self._mirror.deskew(points, stamps_ns, source, fixed_frame, at_ns, out=out)

    def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None = None,
        averaging_interval_s: float = 0.1,
        *,
        reference_frame: str | None = None,
        reference_point: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
        reference_point_frame: str | None = None,
    ) -> Velocity:
        """As `Mirror.lookup_velocity`."""
        return self._mirror.lookup_velocity(
            tracking_frame,
            observation_frame,
            stamp_ns,
            averaging_interval_s,
            reference_frame=reference_frame,
            reference_point=reference_point,
            reference_point_frame=reference_point_frame,
        )

    def frames(self) -> list[str]:
        """As `Mirror.frames`."""
        return self._mirror.frames()

    def frame(self, name: str) -> FrameInfo:
        """As `Mirror.frame`."""
        return self._mirror.frame(name)

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """As `Mirror.parent`."""
        return self._mirror.parent(frame, stamp_ns)

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        """As `Mirror.chain`."""
        return self._mirror.chain(target, source, stamp_ns)

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """As `Mirror.explain`."""
        return self._mirror.explain(target, source, stamp_ns)
