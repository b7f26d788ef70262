"""`AsyncMirror`: a copy of the server's tree in this process, kept up to date by its stream."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final, Self, TypeVar

from zenoh_tf import Dropped, LatestTransform, StampedTransform, TransformArray, wire
from zenoh_tf.errors import TransformException

from ..mirror.base_mirror import BaseMirror
from ..mirror.reads import PLAIN
from ..requests import lookups
from ..requests.receipt import Receipt
from ..requests.request import Request
from ..session.calls import raise_if_forked
from .gate import AsyncGate
from .mirror_transaction import AsyncMirrorTransaction
from .session.connection import Connection
from .session.shared_reads import SharedReads
from .session.threads import in_thread
from .session.waits import in_rounds
from .transaction import AsyncTransaction, repeat

T = TypeVar("T")

if True:  # asynchronous
    #: Lookups of one mirror that wait at once, each on a thread; others wait for one of these.
    _MAX_WAITING: Final = 64
    #: A thread waits for so long, and then again.
    _ROUND_S: Final = 1.0


class AsyncMirror(BaseMirror):
    """A copy of the server's tree in this process; made by `AsyncTransformClient.mirror`.

    Its lookups are as fast as those of an embedded tree, and send no message. Those with a
    `timeout_s` or a `max_age_s` are coroutines, as they may wait or ask; a thread waits for them,
    not the event loop. The others are plain methods, which answer at once. What they read is
    always a state that the server's tree has had: the commits up to `seq`, each as a whole, and
    none after it. `age_s` says how old that state may be. Several lookups may see several such
    states, but never go back while the same server runs. Writes go to the server, as always.

    While the server is away, or the link is cut, the last state is served and its age grows.
    The contract: docs/how-to/mirrors.md. An asynchronous context manager, which closes itself at
    the end.

    Concurrency: lookups and properties, from any thread; coroutines, from the client's event loop.

    Example:
        ``async with await tf.mirror() as m: print(await m.lookup_transform("map", "base"))``
    """

    if True:  # asynchronous
        _taken = PLAIN

    def __init__(
        self,
        connection: Connection,
        reads: SharedReads,
        timeout_s: float,
        interest: wire.Interest | None,
    ) -> None:
        """Use `AsyncTransformClient.mirror` instead."""
        super().__init__(connection.opened, timeout_s, interest)
        self._connection = connection
        self._reads = reads
        if True:  # asynchronous
            self._threads = asyncio.Semaphore(_MAX_WAITING)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Stop following the server. Lookups then raise ServerUnavailable. May be called again."""
        await in_thread(self._end)

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
        raise_if_forked()
        awaited = receipt or self._connection.opened.last_receipt
        if awaited is not None and not self._has(awaited):
            await in_thread(lambda: self._wait_until(awaited, timeout_s))

    # --- lookups that may wait

    async def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform`."""
        if True:  # asynchronous
            if timeout_s > 0:
                return await self._waited(
                    lambda wait_s: self._tree.lookup_transform(
                        target, source, stamp_ns, wait_s, max_gap_s=max_gap_s
                    ),
                    timeout_s,
                )
        return self._tree.lookup_transform(target, source, stamp_ns, timeout_s, max_gap_s=max_gap_s)

    async def lookup_transform_full(
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
        if True:  # asynchronous
            if timeout_s > 0:
                return await self._waited(
                    lambda wait_s: self._tree.lookup_transform_full(
                        *frames, wait_s, max_gap_s=max_gap_s
                    ),
                    timeout_s,
                )
        return self._tree.lookup_transform_full(*frames, timeout_s, max_gap_s=max_gap_s)

    async def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool:
        """As `TransformTree.can_transform`."""
        if True:  # asynchronous
            if timeout_s > 0 and not self._tree.can_transform(target, source, stamp_ns):
                with contextlib.suppress(TransformException):
                    await self.lookup_transform(target, source, stamp_ns, timeout_s)
                return self._tree.can_transform(target, source, stamp_ns)
        return self._tree.can_transform(target, source, stamp_ns, timeout_s)

    if True:  # asynchronous

        async def _waited(self, lookup: Callable[[float], T], timeout_s: float) -> T:
            """Call `lookup` with its time-out. If it has to wait, a thread does, in rounds, so that
            a call that is cancelled occupies it for a round at most."""
            deadline_s = time.monotonic() + timeout_s
            with contextlib.suppress(*lookups.MAY_SUCCEED_LATER):
                return lookup(0.0)
            async with self._threads:
                return await in_rounds(
                    lambda round_s: in_thread(functools.partial(lookup, round_s)),
                    deadline_s,
                    _ROUND_S,
                )

    # --- lookups that may ask the server

    async def lookup_latest_transform(
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
        return await self._ask(lookups.lookup_latest_transform(target, source))

    async def lookup_latest_transform_xact(
        self, target: str, source: str, max_age_s: float | None = None
    ) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform_xact`, or by query.

        Args:
            max_age_s: As for `lookup_latest_transform`, in seconds.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return (self._current or self._tree).lookup_latest_transform_xact(target, source)
        return await self._ask(lookups.lookup_latest_transform_xact(target, source))

    async def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]], max_age_s: float | None = None
    ) -> list[LatestTransform]:
        """As `TransformTree.lookup_latest_transforms_xact`, or by query.

        Args:
            max_age_s: As for `lookup_latest_transform`, in seconds.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return self._tree.lookup_latest_transforms_xact(pairs)
        return await self._ask(lookups.lookup_latest_transforms_xact(pairs))

    def gate(
        self,
        target: str,
        *,
        queue_size: int = 100,
        timeout_s: float = 1.0,
        on_drop: Callable[[Dropped[Any]], object] | None = None,
        max_gap_s: float | None = None,
    ) -> AsyncGate:
        """As `TransformTree.gate`: make a gate, which looks up in the mirror.

        Example:
            ``async with m.gate("map") as gate: gate.put(image, "camera", stamp_ns)``
        """
        if True:  # asynchronous
            return AsyncGate(_GateSource(self), target, queue_size, timeout_s, on_drop, max_gap_s)
        return AsyncGate(self, target, queue_size, timeout_s, on_drop, max_gap_s)

    async def run_transaction(
        self, function: Callable[[AsyncTransaction], Awaitable[T]], attempts: int = 10
    ) -> T:
        """As `AsyncTransformClient.run_transaction`, with reads in the mirror: one round trip.

        The server compares what was read with its own state, so the transaction is strictly
        serializable, however old the mirror is. A read waits for what this mirror's transactions
        have written to the same frames; after a conflict, the next attempt waits for the state that
        the last one was in conflict with.

        Example:
            ``await m.run_transaction(lift)``
        """
        raise_if_forked()

        def begin(attempt: int) -> AsyncTransaction:
            return AsyncMirrorTransaction(self._connection, self._reads, self, attempt)

        return await repeat(begin, function, attempts)

    async def _ask(self, request: Request[T]) -> T:
        raise_if_forked()
        return await self._connection.call(request)


if True:  # asynchronous

    class _GateSource:
        """The lookups of a mirror's gate, all as coroutines."""

        def __init__(self, mirror: AsyncMirror) -> None:
            self.lookup_transform = mirror.lookup_transform
            self._mirror = mirror

        async def lookup_transforms(
            self,
            targets: str,
            sources: str,
            stamps_ns: list[int],
            *,
            max_gap_s: float | None = None,
        ) -> TransformArray:
            return self._mirror.lookup_transforms(targets, sources, stamps_ns, max_gap_s=max_gap_s)
