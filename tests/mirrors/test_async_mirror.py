"""Mirrors of the asynchronous client, which are those of the synchronous one."""

from __future__ import annotations

import asyncio
from functools import partial

import pytest

from tests.processes.servers import ServerProcess
from tests.support.asynchronous import connected
from tests.support.small_robot import stamped
from zenoh_tf.errors import ServerUnavailable, TimeoutException
from zenoh_tf_client import Receipt, Transaction

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
        m = await tf.mirror()
        assert ticks
        await tf.set_transform(stamped("base", 1))
        await asyncio.to_thread(m.wait_for)
        waiting = asyncio.gather(
            asyncio.to_thread(m.lookup_transform, "map", "base", 2, DEADLINE_S),
            asyncio.to_thread(m.can_transform, "map", "base", 2, DEADLINE_S),
        )
        await tf.set_transform(stamped("base", 3))  # on the same loop
        found, can = await waiting
        assert (found.stamp_ns, can) == (2, True)
        before = ticks
        with pytest.raises(TimeoutException):
            await asyncio.to_thread(m.wait_for, Receipt(m.instance, 1 << 40), 0.2)
        assert ticks > before
        ticking.cancel()
    with pytest.raises(ServerUnavailable):
        m.lookup_transform("map", "base")


async def test_a_mirror_that_nobody_waits_for_is_closed(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        beginning = asyncio.create_task(tf.mirror())
        await asyncio.sleep(0)
        beginning.cancel()
        with pytest.raises(asyncio.CancelledError):
            await beginning
        while (await tf.stats())["waiters"]:
            await asyncio.sleep(0.01)


async def test_a_transaction(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await tf.set_transform(stamped("base", 1))
        with await tf.mirror() as m:

            def move(tx: Transaction) -> None:
                found = tx.lookup_latest_transform_xact("map", "base")
                tx.set_transform(stamped("base", found.newest_stamp_ns + 1))

            await asyncio.gather(*(asyncio.to_thread(m.run_transaction, move) for _ in range(3)))
            await asyncio.to_thread(partial(m.wait_for, timeout_s=DEADLINE_S))
            assert m.lookup_latest_transform("map", "base").newest_stamp_ns == 4


async def test_a_gate(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await tf.set_transform(stamped("base", 1))
        with await tf.mirror() as m, m.gate("map", timeout_s=DEADLINE_S) as gate:
            gate.put("late", "base", 3)
            await tf.set_transform(stamped("base", 5))
            async for item, transform in gate:
                assert (item, transform) == ("late", m.lookup_transform("map", "base", 3))
                break
