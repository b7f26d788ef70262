"""Mirrors of the asynchronous client: lookups that do not suspend, and coroutines that wait."""

from __future__ import annotations

import asyncio
import inspect
import threading

import pytest

from tests.processes.servers import ServerProcess
from tests.support.asynchronous import connected
from tests.support.small_robot import stamped
from tests.support.waiting import wait_until
from zenoh_tf.errors import (
    ExtrapolationException,
    InvalidArgumentException,
    TimeoutException,
)
from zenoh_tf_client import AsyncMirror, Mirror, OutsideInterest, Receipt

DEADLINE_S = 30.0


async def test_the_loop_goes_on_while_a_mirror_begins_and_waits(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        ticks = 0

        async def tick() -> None:
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0)

        ticking = asyncio.create_task(tick())
        async with await tf.mirror([("map", "later")]) as m:
            before = ticks
            with pytest.raises(TimeoutException):
                await m.wait_for(Receipt(m.instance, 1 << 40), timeout_s=0.2)
            assert ticks > before
            with pytest.raises(OutsideInterest):
                await m.lookup_transform("map", "other")
            waiting = asyncio.create_task(m.wait_for(Receipt(m.instance, 1 << 40)))
            await asyncio.sleep(0.05)
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
        ticking.cancel()


async def test_the_loop_goes_on_while_lookups_wait(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await tf.set_transform(stamped("base", 1))
        async with await tf.mirror() as m:
            waiting = asyncio.gather(
                m.lookup_transform("map", "base", 2, DEADLINE_S),
                m.lookup_transform_full("map", 2, "base", 2, "map", DEADLINE_S),
                m.can_transform("map", "base", 2, DEADLINE_S),
            )
            await asyncio.sleep(0.05)
            await tf.set_transform(stamped("base", 3))  # on the same loop
            found, full, can = await waiting
            assert (found.stamp_ns, full.stamp_ns, can) == (2, 2, True)
            with pytest.raises(ExtrapolationException):
                await m.lookup_transform("map", "base", 4, timeout_s=0.05)
            with pytest.raises(ExtrapolationException):
                await m.lookup_transform_full("map", 4, "base", 4, "map", timeout_s=0.05)
            assert not await m.can_transform("map", "base", 4, timeout_s=0.05)
            with pytest.raises(InvalidArgumentException):
                await m.lookup_transform("map", "base", 4, timeout_s=-1)


async def test_a_gate(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await tf.set_transform(stamped("base", 1))
        async with await tf.mirror() as m, m.gate("map", timeout_s=DEADLINE_S) as gate:
            gate.put("late", "base", 3)
            await asyncio.sleep(0.1)
            assert gate.stats()["held"] == 1
            await tf.set_transform(stamped("base", 5))
            item, transform = await gate.get(DEADLINE_S)
            assert (item, transform) == ("late", await m.lookup_transform("map", "base", 3))


def test_it_has_the_methods_of_a_mirror() -> None:
    names = {name for name in dir(Mirror) if not name.startswith("_")}
    assert {name for name in dir(AsyncMirror) if not name.startswith("_")} == names
    may_wait = {"close", "wait_for", "run_transaction"}
    for name in names:
        method = getattr(Mirror, name)
        if callable(method) and {"timeout_s", "max_age_s"} & {
            *inspect.signature(method).parameters
        }:
            may_wait.add(name)
    may_wait.remove("gate")  # its time-out is that of items
    assert len(may_wait) == 9
    for name in names:
        is_coroutine = inspect.iscoroutinefunction(getattr(AsyncMirror, name))
        assert is_coroutine == (name in may_wait), name


async def test_cancelled_waits_leave_no_thread(server: ServerProcess) -> None:
    async with await connected(server) as tf, await tf.mirror() as m:
        before = threading.active_count()
        for _ in range(3):
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(m.lookup_transform("map", "nowhere", timeout_s=3600), 0.05)
        wait_until(lambda: threading.active_count() <= before)
