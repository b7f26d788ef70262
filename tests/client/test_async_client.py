"""What the asynchronous client adds: shared messages, bounds, event loops."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
import uvloop

from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.asynchronous import assert_idle, connected, fill, sent_by
from tests.support.threads import together
from zenoh_tf.errors import (
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    OutcomeUnknown,
    ServerUnavailable,
    TransformException,
)
from zenoh_tf_client import AsyncTransformClient
from zenoh_tf_client.aio.session.connection import MAX_CALLS, MAX_WAITING_LOOKUPS

from .test_client import S, link


async def test_calls_of_one_turn_share_messages(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await fill(tf)
        sent = sent_by(tf)
        await tf.lookup_transform("map", "base")
        assert sent == ["lookup"]
        sent.clear()
        results: list[Any] = await asyncio.gather(
            *(tf.lookup_transform("map", "base", (20 + row) * S // 10) for row in range(10)),
            *(tf.set_transform(link("map", f"new{row}", row)) for row in range(10)),
            *(tf.set_transform(link("map", f"arm{row}", row), "arm") for row in range(10)),
            tf.lookup_latest_transform("map", "odom"),
            tf.latest_common_time("map", "base"),
            tf.can_transform("map", "nowhere"),
            tf.lookup_transform("map", "nowhere"),
            tf.frame("base"),
            return_exceptions=True,
        )
        assert sorted(sent) == ["batch", "batch", "info", "lookup"]
        assert [result.stamp_ns for result in results[:10]] == [
            (20 + row) * S // 10 for row in range(10)
        ]
        assert results[10:30] == [True] * 20
        assert results[30].newest_stamp_ns == 3 * S
        assert results[31:33] == [3 * S, False]
        assert isinstance(results[33], LookupException)
        assert results[34].parent == "odom"
        assert (await tf.frame("arm3")).authority == "arm"
        assert_idle(tf)


async def test_what_is_in_memory_is_read_without_suspending(server: ServerProcess) -> None:
    async with await AsyncTransformClient.connect(server.endpoint) as tf:
        await fill(tf)
        assert tf.reads == "shared"
        sent = sent_by(tf)
        found = tf.lookup_transform("map", "base")
        with pytest.raises(StopIteration) as ended:
            found.send(None)
        assert ended.value.value.stamp_ns == 3 * S
        with pytest.raises(LookupException):
            await tf.lookup_transform("map", "nowhere")
        assert (await tf.sample("map", "base", [2 * S])).ok.all()
        assert (await tf.frame("base")).parent == "odom"
        async with tf.transaction() as tx:
            await tx.lookup_latest_transform_xact("map", "base")
            tx.set_transform(link("map", "goal", 1))
        assert sent == ["commit"]
        assert await tf.can_transform("map", "goal", timeout_s=5.0)
        late = asyncio.create_task(tf.lookup_transform("map", "late", timeout_s=40.0))
        while not (await tf.stats())["waiters"]:
            await asyncio.sleep(0.01)
        await tf.set_transform(link("map", "late", 1))
        assert (await late).child_frame == "late"
        server.freeze()
        while tf.reads == "shared":  # the lease lapses
            await asyncio.sleep(0.01)
        asked = asyncio.create_task(tf.lookup_transform("map", "base"))
        await asyncio.sleep(0.01)
        assert not asked.done()
        server.send_signal(signal.SIGCONT)
        assert (await asked).stamp_ns == 3 * S
        assert_idle(tf)
    assert tf.reads == "query"


async def test_a_bad_call_fails_alone(server: ServerProcess) -> None:
    """A whole message would be refused for its sake."""
    async with await connected(server) as tf:
        await fill(tf)
        names: list[Any] = ["base"] * 50
        names[7], names[30], names[31] = "\ud800", 5, "x" * 100_000
        results = await asyncio.gather(
            *(tf.lookup_transform("map", name) for name in names), return_exceptions=True
        )
        assert isinstance(results[7], InvalidArgumentException)
        assert isinstance(results[30], TransformException)
        assert isinstance(results[31], LimitExceeded)
        good = [row for row, found in enumerate(results) if not isinstance(found, Exception)]
        assert good == [row for row in range(50) if row not in (7, 30, 31)]
        stored = await asyncio.gather(
            *(tf.set_transform(link("map", f"w{row}", 1)) for row in range(9)),
            tf.set_transform(link("map", "x" * 300, 1)),
            tf.set_transform(link("map", "map", 1)),
            return_exceptions=True,
        )
        assert stored[:9] == [True] * 9
        assert all(isinstance(error, TransformException) for error in stored[9:])
        assert_idle(tf)


async def test_a_lookup_that_waits_delays_no_other_call(server: ServerProcess) -> None:
    async with await connected(server) as tf:
        await fill(tf)
        late = asyncio.gather(
            *(tf.lookup_transform("map", f"late{row}", timeout_s=40.0) for row in range(200))
        )
        now, _ = await asyncio.gather(tf.lookup_transform("map", "base"), tf.stats())
        assert now.stamp_ns == 3 * S
        assert not late.done()
        await tf.set_transforms_xact([link("map", f"late{row}", 1) for row in range(200)])
        assert [found.child_frame for found in await late] == [f"late{n}" for n in range(200)]
        with pytest.raises(LookupException):
            await tf.lookup_transform("map", "never", timeout_s=0.1)
        assert_idle(tf)


async def test_more_calls_than_there_is_room_for(server: ServerProcess) -> None:
    """Callers beyond the limit wait, and all get their results."""
    calls = 9_000
    assert calls > 2 * MAX_CALLS
    async with await connected(server, 40.0) as tf:
        await fill(tf)
        sent = sent_by(tf)
        tasks = [asyncio.create_task(tf.lookup_transform("map", "base")) for _ in range(calls)]
        server.freeze()  # for less than its lease, or all calls would end
        for _ in range(50):
            await asyncio.sleep(0.002)
        assert tf._connection._room.locked()
        assert len(sent) * 1000 <= MAX_CALLS
        server.send_signal(signal.SIGCONT)
        assert {found.stamp_ns for found in await asyncio.gather(*tasks)} == {3 * S}
        assert_idle(tf)
        waits = [
            asyncio.create_task(tf.can_transform("map", "late", timeout_s=40.0))
            for _ in range(MAX_WAITING_LOOKUPS + 500)
        ]
        while (await tf.stats())["waiters"] < MAX_WAITING_LOOKUPS:
            await asyncio.sleep(0.01)
        assert (await tf.stats())["waiters"] == MAX_WAITING_LOOKUPS
        await tf.set_transform(link("map", "late", 1))  # has room of its own
        assert all(await asyncio.gather(*waits))
        assert_idle(tf)


async def test_calls_under_way_fail_when_the_client_is_closed(server: ServerProcess) -> None:
    tf = await connected(server, 400.0)  # far beyond this test's own time-out
    await fill(tf)
    sensor = await tf.broadcaster("sensor")
    read = asyncio.create_task(tf.lookup_transform("map", "never", timeout_s=400.0))
    await tf.stats()
    server.freeze()
    lone = asyncio.create_task(tf.frames())
    write = asyncio.create_task(tf.set_transform(link("map", "base", 9)))
    await asyncio.sleep(0.05)
    unsent = asyncio.create_task(tf.lookup_transform("map", "base"))
    await asyncio.sleep(0)
    await asyncio.gather(tf.close(), tf.close())
    for task, error in (
        (read, ServerUnavailable),
        (lone, ServerUnavailable),
        (unsent, ServerUnavailable),
        (write, OutcomeUnknown),
    ):
        with pytest.raises(error, match="is closed"):
            await task
    for call in (tf.frames(), tf.broadcaster("x")):
        with pytest.raises(ServerUnavailable, match="is closed"):
            await call
    with pytest.raises(ServerUnavailable, match="is closed"):
        sensor.send(link("a", "b", 1))
    sensor.close()
    assert repr(tf).endswith("closed>") and repr(sensor).endswith("closed>")
    assert_idle(tf)


async def test_a_server_that_goes_and_comes_back(
    start_server: Callable[..., ServerProcess],
) -> None:
    server = start_server()
    servers = [server]
    async with await connected(server, 2.0) as tf:
        await fill(tf)
        first = await tf.instance
        waiting = asyncio.create_task(tf.lookup_transform("map", "never", timeout_s=40.0))
        await tf.stats()
        server.kill()
        with pytest.raises(ServerUnavailable):
            await waiting
        with pytest.raises(ServerUnavailable):
            await tf.lookup_transform("map", "base")
        servers.append(start_server(endpoint=server.endpoint))
        deadline_s = time.monotonic() + 30
        while True:
            with contextlib.suppress(ServerUnavailable):
                await tf.set_transform(link("map", "base", 7))
                break
            assert time.monotonic() < deadline_s
            await asyncio.sleep(0.05)
        assert (await tf.lookup_transform("map", "base")).stamp_ns == 7
        assert await tf.instance != first
        assert_idle(tf)


async def test_the_loop_goes_on_while_a_server_takes_nothing(server: ServerProcess) -> None:
    """Zenoh blocks senders then, but only on a thread."""
    async with await connected(server, 1.0) as tf:
        sensor = await tf.broadcaster("sensor")
        await fill(tf)
        server.freeze()
        rows = [link("map", f"row{row}", 1) for row in range(10_000)]
        tasks: list[asyncio.Task[Any]] = []
        tasks += [asyncio.create_task(asyncio.to_thread(sensor.send, rows)) for _ in range(4)]
        tasks += [asyncio.create_task(tf.set_transforms_xact(rows, f"{n}")) for n in range(20)]
        turns = 0
        while not all(task.done() for task in tasks):  # Zenoh gives a blocked put up after 5 s
            tasks.append(asyncio.create_task(tf.lookup_transform("map", "base")))
            await asyncio.sleep(0.01)
            turns += 1
            if turns == 200:
                break
        assert turns > 20
        server.send_signal(signal.SIGCONT)
        results = await asyncio.gather(*tasks[4:24], return_exceptions=True)
        assert all(isinstance(found, OutcomeUnknown | ServerUnavailable) for found in results)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def test_connect_fails_and_is_cancelled(server: ServerProcess) -> None:
    with pytest.raises(ServerUnavailable):
        await AsyncTransformClient.connect(free_endpoint(), timeout_s=0.1)
    with pytest.raises(InvalidArgumentException):
        await AsyncTransformClient.connect("nonsense")
    with pytest.raises(TypeError, match=r"use await AsyncTransformClient\.connect\("):
        AsyncTransformClient(server.endpoint)  # type: ignore[arg-type]
    async with await connected(server) as tf:
        connecting = asyncio.create_task(connected(server))
        await asyncio.sleep(0)
        connecting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await connecting
        while len(await tf.clients()) > 1:  # the thread that connects closes what it gets
            await asyncio.sleep(0.01)


def test_each_loop_has_a_client_of_its_own(server: ServerProcess) -> None:
    with pytest.raises(RuntimeError):
        asyncio.run(misused(asyncio.run(connected(server))))
    done: list[int] = []

    async def main(number: int) -> None:
        async with await connected(server) as tf:
            for stamp_ns in range(1, 50):
                await tf.set_transform(link("map", f"frame{number}", stamp_ns))
                found = await tf.lookup_latest_transform("map", f"frame{number}")
                assert found.stamp_ns == stamp_ns
        done.append(number)

    runners = [asyncio.run, uvloop.run]
    together(*(partial(runners[number % 2], main(number)) for number in range(4)))
    assert sorted(done) == [0, 1, 2, 3]


async def misused(tf: AsyncTransformClient) -> None:
    await tf.frames()
