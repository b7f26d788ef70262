"""Cancelled calls of the asynchronous client leave nothing behind."""

from __future__ import annotations

import asyncio
import signal
import sys

import pytest

from tests.processes.servers import ServerProcess
from tests.support.asynchronous import assert_idle, connected, fill, idle
from zenoh_tf.errors import (
    OutcomeUnknown,
)

from .test_client import link


async def test_cancelled_calls_leave_nothing_behind(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await fill(tf)
        # Before they are sent, while they are collected, and at every step to the result.
        for turns in range(8):
            tasks = [
                asyncio.create_task(call)
                for call in (
                    *(tf.lookup_transform("map", "base") for _ in range(20)),
                    *(tf.lookup_transform("map", "never", timeout_s=40.0) for _ in range(20)),
                    tf.frames(),
                )
            ]
            for _ in range(turns):
                await asyncio.sleep(0)
            for task in tasks:
                task.cancel()
            results = await asyncio.gather(*tasks, return_exceptions=True)
            assert any(isinstance(found, asyncio.CancelledError) for found in results)
            await idle(tf)
        # One of several in a message: the others are answered.
        tasks = [asyncio.create_task(tf.lookup_transform("map", "base")) for _ in range(20)]
        for _ in range(3):
            await asyncio.sleep(0)
        tasks[4].cancel()
        results = await asyncio.gather(*tasks, return_exceptions=True)
        assert [type(found).__name__ for found in results].count("StampedTransform") == 19
        assert_idle(tf)
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(tf.lookup_transform("map", "never", timeout_s=40.0), 0.05)
        await idle(tf)


async def test_calls_are_cancelled_while_replies_arrive(server: ServerProcess) -> None:
    """Zenoh's thread is in a callback, or about to be, at any point of a cancellation."""
    async with await connected(server) as tf:
        await fill(tf)
        for round_ in range(300):
            tasks = [asyncio.create_task(tf.frame("base")) for _ in range(10)]
            await asyncio.sleep(round_ * 5e-6)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        assert_idle(tf)
        assert await tf.can_transform("map", "base")


async def test_a_cancelled_write_says_that_its_outcome_is_unknown(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await fill(tf)
        never_sent = asyncio.create_task(tf.set_transform(link("map", "unsent", 1)))
        await asyncio.sleep(0)  # it is collected, and sent in the next turn
        never_sent.cancel()
        with pytest.raises(asyncio.CancelledError) as caught:
            await never_sent
        assert caught.value.__cause__ is None
        server.freeze()
        sent = asyncio.create_task(tf.set_transform(link("map", "sent", 1)))
        await asyncio.sleep(0.05)
        sent.cancel()
        with pytest.raises(asyncio.CancelledError) as caught:
            await sent
        raised: BaseException | None = caught.value
        if sys.version_info < (3, 11):  # awaiting a task raises another error than the task
            raised = caught.value.__context__
        assert raised is not None and isinstance(raised.__cause__, OutcomeUnknown)
        assert_idle(tf)
        server.send_signal(signal.SIGCONT)
        assert "unsent" not in await tf.frames()
