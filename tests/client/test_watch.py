"""`watch`: the pose of a pair, pushed; dead-bands, heartbeats, loss, and who shares what."""

from __future__ import annotations

import asyncio
import itertools
import math
import signal
import threading
from collections.abc import Callable, Iterator

import pytest

from tests.conftest import Main, StartServer
from tests.processes.servers import ServerProcess
from tests.support.small_robot import DEADLINE_S
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import (
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    ServerUnavailable,
    TimeoutException,
)
from zenoh_tf_client import AsyncTransformClient, PoseEvent, TransformClient, Watch

#: Longer than any test: no heartbeat comes in between.
NEVER_S = 3600.0


@pytest.fixture
def tf(shared_server: ServerProcess) -> Iterator[TransformClient]:
    with shared_server.connect() as client:
        client.reset()
        yield client


_stamps = itertools.count(1)


def put(tf: TransformClient, x: float = 0.0, yaw: float = 0.0) -> None:
    pose = Transform.from_rpy(0, 0, yaw, (x, 0, 0))
    tf.set_transform(StampedTransform("map", "base", next(_stamps), pose))


def assert_event(watch: Watch, tf: TransformClient, reason: str | None) -> None:
    """What the watch says of all that was written until now; None: nothing."""
    watch._mirror.wait_for(tf.last_receipt, DEADLINE_S)
    if reason is None:
        with pytest.raises(TimeoutException):
            watch.get(timeout_s=0)
        return
    event = watch.get(timeout_s=DEADLINE_S)
    assert event.reason == reason
    assert event.pose == (None if event.error else tf.lookup_latest_transform("map", "base"))
    assert 0 <= event.age_s < DEADLINE_S


def test_every_change_without_a_dead_band(tf: TransformClient) -> None:
    put(tf)
    with tf.watch("map", "base", heartbeat_s=NEVER_S) as watch:
        assert_event(watch, tf, "found")
        assert_event(watch, tf, None)
        put(tf, 1e-9)
        assert_event(watch, tf, "moved")
        put(tf, 1e-9)  # a new sample of the same pose
        assert_event(watch, tf, None)
        put(tf, 1e-9, 1e-9)
        assert_event(watch, tf, "moved")


def test_dead_bands(tf: TransformClient) -> None:
    put(tf)
    with (
        tf.watch("map", "base", min_translation_m=0.1, heartbeat_s=NEVER_S) as far,
        tf.watch(
            "map", "base", min_translation_m=0.1, min_rotation_rad=0.2, heartbeat_s=NEVER_S
        ) as either,
        tf.watch(
            "map", "base", min_translation_m=math.inf, min_rotation_rad=0.2, heartbeat_s=NEVER_S
        ) as turned,
    ):
        for x, yaw, expected in (
            (0.0, 0.0, ("found", "found", "found")),
            (0.06, 0.0, (None, None, None)),
            (0.09, 0.0, (None, None, None)),  # a drift adds up
            (0.11, 0.0, ("moved", "moved", None)),
            (0.11, 0.15, ("moved", None, None)),  # without a band, any turn is reported
            (0.11, 0.25, ("moved", "moved", "moved")),
            (0.11, 3.1, ("moved", "moved", "moved")),
            (0.11, -3.1, ("moved", None, None)),  # across the end of the range of angles
            (9.0, -3.1, ("moved", "moved", None)),
        ):
            put(tf, x, yaw)
            for watch, reason in zip((far, either, turned), expected, strict=True):
                assert_event(watch, tf, reason)


def test_heartbeats_do_not_move_the_band(tf: TransformClient) -> None:
    put(tf)
    with tf.watch("map", "base", min_translation_m=0.1, heartbeat_s=0.01) as watch:
        assert watch.get().reason == "found"
        put(tf, 0.06)
        pose = tf.lookup_latest_transform("map", "base")
        while (event := watch.get()).pose != pose:
            assert event.reason == "heartbeat"
        assert event.reason == "heartbeat"
        put(tf, 0.11)
        wait_until(lambda: watch.get().reason == "moved", "a drift is not reported")


def test_lost_and_found(tf: TransformClient) -> None:
    with tf.watch("map", "base", heartbeat_s=NEVER_S) as watch:
        event = watch.get()
        assert (event.reason, event.pose) == ("lost", None)
        assert isinstance(event.error, LookupException)
        assert event.error.frame in ("map", "base")
        put(tf, 1)
        assert_event(watch, tf, "found")
        tf.remove_frame("base")
        assert_event(watch, tf, "lost")
        assert_event(watch, tf, None)
        put(tf, 1)
        assert_event(watch, tf, "found")
    with tf.watch("map", "later", heartbeat_s=0.01) as watch:
        assert watch.get().reason == "lost"
        beat = watch.get()
        assert (beat.reason, beat.pose, type(beat.error)) == ("heartbeat", None, LookupException)


def test_a_slow_consumer_gets_the_newest(tf: TransformClient) -> None:
    put(tf)
    with tf.watch("map", "base", heartbeat_s=NEVER_S) as watch:
        assert_event(watch, tf, "found")
        for x in range(1, 101):
            put(tf, x)
        assert_event(watch, tf, "moved")
        assert_event(watch, tf, None)


def test_stillness_and_silence(start_server: StartServer) -> None:
    server = start_server()
    with server.connect() as tf, tf.watch("map", "base", heartbeat_s=0.05) as watch:
        put(tf, 1)
        wait_until(lambda: (event := watch.get()).reason == "heartbeat" and event.pose, "not found")
        wait_until(lambda: watch.get().age_s < 1, "a still pose is old")
        server.freeze()
        ages: list[float] = []
        while not ages or ages[-1] < 1.5:
            event = watch.get()
            assert (event.reason, event.error) == ("heartbeat", None)
            assert event.pose is not None
            ages.append(event.age_s)
        assert ages[-20:] == sorted(ages[-20:])
        server.send_signal(signal.SIGCONT)
        wait_until(lambda: watch.get().age_s < 1, "it does not become young again")
        put(tf, 2)
        wait_until(lambda: watch.get().reason == "moved", "not moved")
        server.kill()
        second = start_server(endpoint=server.endpoint)
        wait_until(lambda: watch.get().reason == "lost", "the new server has no frames")
        with second.connect() as other:
            put(other, 3)
            wait_until(lambda: watch.get().reason == "found", "not found at the new server")


@pytest.mark.parametrize("closed", ["watch", "client"])
def test_close_ends_iterations(
    shared_server: ServerProcess, tf: TransformClient, closed: str
) -> None:
    put(tf)
    with shared_server.connect() as other:
        watch = other.watch("map", "base", heartbeat_s=NEVER_S)
        events: list[PoseEvent] = []
        thread = threading.Thread(target=lambda: events.extend(watch), daemon=True)
        thread.start()
        wait_until(lambda: events, "no event came")
        (watch if closed == "watch" else other).close()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
        assert [event.reason for event in events] == ["found"]
        with pytest.raises(ServerUnavailable, match="closed"):
            watch.get()
        assert list(watch) == []
        assert "closed" in repr(watch)
        watch.close()


def test_equal_watches_share_an_interest(start_server: StartServer) -> None:
    server = start_server()
    with server.connect() as tf, server.connect() as other:
        put(tf)
        with (
            tf.watch("map", "base", min_translation_m=0.1) as one,
            other.watch("map", "base", heartbeat_s=0.5) as two,
        ):
            assert [one.get().reason, two.get().reason] == ["found", "found"]
            assert tf.stats()["interests"] == 1
            with tf.watch("map", "base", max_rate_hz=50) as thinned:
                assert thinned.get().reason == "found"
                assert tf.stats()["interests"] == 2
                put(tf, 1)
                moved = [next(e for e in w if e.reason == "moved") for w in (one, two, thinned)]
                assert [e.pose and e.pose.transform.translation[0] for e in moved] == [1, 1, 1]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("min_translation_m", -1.0),
        ("min_rotation_rad", math.nan),
        ("heartbeat_s", 0.0),
        ("heartbeat_s", math.inf),
        ("max_rate_hz", 0.0),
    ],
)
def test_wrong_arguments(tf: TransformClient, field: str, value: float) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        tf.watch("map", "base", **{field: value})
    assert caught.value.field == field


def test_wrong_names(tf: TransformClient) -> None:
    for name, error in (("", InvalidArgumentException), ("x" * 5000, LimitExceeded)):
        with pytest.raises(error):
            tf.watch("map", name)


async def test_asyncio(
    shared_server: ServerProcess, tf: TransformClient, run: Callable[[Main], None]
) -> None:
    put(tf)
    async with await AsyncTransformClient.connect(shared_server.endpoint) as client:
        watch = await client.watch("map", "base", min_translation_m=0.1, heartbeat_s=NEVER_S)

        async def next_event() -> PoseEvent:
            return await anext(aiter(watch))

        first = await next_event()
        assert (first.reason, first.error) == ("found", None)
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(next_event(), 0.05)
        waiting = asyncio.create_task(next_event())
        for x in (0.05, 5.0):
            put(tf, x)
        moved = await asyncio.wait_for(waiting, DEADLINE_S)
        assert moved.pose is not None
        assert (moved.reason, moved.pose.transform.translation[0]) == ("moved", 5)
        cancelled = asyncio.create_task(next_event())
        await asyncio.sleep(0.01)
        cancelled.cancel()
        for x in range(6, 50):  # the loop is busy meanwhile
            put(tf, x)
        watch._mirror.wait_for(tf.last_receipt, DEADLINE_S)
        newest = await next_event()
        assert newest.pose == tf.lookup_latest_transform("map", "base")
        tf.remove_frame("base")
        assert (await next_event()).reason == "lost"

        async def gather() -> list[PoseEvent]:
            return [event async for event in watch]

        tasks = [asyncio.create_task(gather()) for _ in range(2)]
        await asyncio.sleep(0.01)
        await asyncio.to_thread(watch.close)
        assert await asyncio.wait_for(asyncio.gather(*tasks), DEADLINE_S) == [[], []]
        with pytest.raises(ServerUnavailable):
            watch.get()

        with await client.watch("map", "base", heartbeat_s=0.02) as other:
            events = []
            async for event in other:
                events.append(event.reason)
                if len(events) == 4:
                    break
            assert events == ["lost", "heartbeat", "heartbeat", "heartbeat"]
