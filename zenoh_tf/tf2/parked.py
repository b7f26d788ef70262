"""The lookups of a tree as coroutines, which wait without a thread each.

The native tree parks a lookup on the frames that it waits for, and the commit that completes it
wakes it.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from zenoh_tf import StampedTransform, Transform, TransformTree, _core, threads
from zenoh_tf.errors import MAY_SUCCEED_LATER
from zenoh_tf.gap_limit import max_gap_ns


class ParkedLookups:
    """As the tree's methods, made by `parked_lookups`. Thread safety: the loop's thread."""

    def __init__(self, tree: TransformTree, queue: _core.WakeQueue) -> None:
        self._tree = tree
        self._queue = queue
        self._ids = itertools.count()
        self._waiting: dict[int, asyncio.Future[None]] = {}

    async def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None, timeout_s: float, **gap: Any
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform`."""
        with contextlib.suppress(*MAY_SUCCEED_LATER):
            return self._tree.lookup_transform(target, source, stamp_ns, **gap)
        op = _core.OP_COMMON if stamp_ns is None else _core.OP_AT
        return await self._wait(op, (target, source), (stamp_ns,), timeout_s, **gap)

    async def lookup_transform_full(self, *lookup: Any, **gap: Any) -> StampedTransform:
        """As `TransformTree.lookup_transform_full`."""
        target, target_ns, source, source_ns, fixed_frame, timeout_s = lookup
        with contextlib.suppress(*MAY_SUCCEED_LATER):
            return self._tree.lookup_transform_full(*lookup[:-1], **gap)
        names, stamps = (target, source, fixed_frame), (target_ns, source_ns)
        return await self._wait(_core.OP_FULL, names, stamps, timeout_s, **gap)

    async def _wait(
        self,
        op: int,
        names: tuple[str, ...],
        stamps_ns: tuple[int | None, ...],
        timeout_s: float,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        number, begin_s = next(self._ids), time.monotonic()
        rows = [np.array([row], np.uint32) for row in range(len(names))]
        stamps = [
            np.array([_core.NO_STAMP if each is None else each], np.int64) for each in stamps_ns
        ]
        fixed, source_stamp = (rows[2], stamps[1]) if op == _core.OP_FULL else (None, None)
        lookup = np.array([op], np.uint8), rows[0], rows[1], stamps[0], fixed, source_stamp
        gap, queue = max_gap_ns(max_gap_s), self._queue
        parked = _core.park_lookups(self._tree, queue, number, names, *lookup, max_gap_ns=gap)
        woken = self._waiting[number] = asyncio.get_running_loop().create_future()
        try:
            if not parked.start():
                with contextlib.suppress(asyncio.TimeoutError):  # on 3.10 not the built-in one
                    await asyncio.wait_for(woken, timeout_s)
        finally:
            del self._waiting[number]
            parked.cancel()
        _, answers_ns, _, poses, errors, *_ = parked.result(time.monotonic() - begin_s)
        for _, error in errors:
            raise error
        x, y, z, *turn = poses[0].tolist()
        return StampedTransform(names[0], names[1], int(answers_ns[0]), Transform((x, y, z), turn))

    def wake(self, numbers: list[int]) -> None:
        """Continue the lookups that are complete."""
        for number in numbers:
            woken = self._waiting.get(number)
            if woken is not None and not woken.done():
                woken.set_result(None)


@contextlib.contextmanager
def parked_lookups(tree: TransformTree) -> Iterator[ParkedLookups]:
    """Yield a tree's lookups as coroutines, for the running event loop.

    Raises RuntimeError if the system has no thread left.
    """
    queue, loop = _core.WakeQueue(), asyncio.get_running_loop()
    lookups = ParkedLookups(tree, queue)

    def serve() -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed
            while (numbers := queue.take()) is not None:
                loop.call_soon_threadsafe(lookups.wake, numbers)

    threads.start("tf2 wakes", serve)
    try:
        yield lookups
    finally:
        queue.close()
