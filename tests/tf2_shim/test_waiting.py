"""Lookups that wait: with a time-out, as futures under asyncio, as rclpy's executors await."""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import CancelledError
from typing import Any

import pytest

import zenoh_tf_client.tf2
from tests.support.waiting import wait_until
from zenoh_tf import GapTooLong, tf2

from .conftest import waiters
from .messages import LATEST, at, lasting, link


def send_when_someone_waits(buffer: tf2.Buffer) -> threading.Thread:
    def run() -> None:
        wait_until(lambda: waiters(buffer))
        buffer.set_transform(link("map", "base", 2), "wheels")

    thread = threading.Thread(target=run)
    thread.start()
    return thread


QUESTIONS: dict[str, Callable[[tf2.Buffer, Any], Any]] = {
    "lookup": lambda buffer, time: buffer.lookup_transform("map", "base", time, lasting(30)),
    "can": lambda buffer, time: buffer.can_transform("map", "base", time, timeout=lasting(30)),
    "full": lambda buffer, time: buffer.lookup_transform_full(
        "map", time, "base", time, "map", lasting(30)
    ),
    "can full": lambda buffer, time: buffer.can_transform_full(
        "map", time, "base", time, "map", lasting(30)
    ),
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_a_wait_ends_with_the_write(buffer: tf2.Buffer, name: str) -> None:
    sender = send_when_someone_waits(buffer)
    assert QUESTIONS[name](buffer, at(2))
    sender.join()


def test_a_time_out_raises_what_is_missing(buffer: tf2.Buffer) -> None:
    with pytest.raises(tf2.LookupException):
        buffer.lookup_transform("map", "gripper", LATEST, lasting(0.1))
    assert buffer.can_transform("map", "gripper", LATEST, lasting(0.1)) is False


def test_await_what_is_there(buffer: tf2.Buffer) -> None:
    got = asyncio.run(buffer.lookup_transform_async("map", "base", at(1)))
    assert got.child_frame_id == "base"
    full = asyncio.run(buffer.lookup_transform_full_async("map", at(1), "base", at(1), "map"))
    assert full == got


def test_await_what_comes_later(buffer: tf2.Buffer) -> None:
    async def both() -> tuple[tf2.TransformStamped, tf2.TransformStamped]:
        return await asyncio.gather(
            buffer.lookup_transform_async("map", "base", at(2)),
            buffer.lookup_transform_full_async("map", at(2), "base", at(2), "map"),
        )

    sender = send_when_someone_waits(buffer)
    first, second = asyncio.run(both())
    sender.join()
    assert first == second
    assert first.header.stamp == tf2.Time(2, 0)


def drive(coroutine: Coroutine[Any, Any, Any]) -> Any:
    """As rclpy's executors do: step by step, and ignores what a step yields."""
    while True:
        try:
            coroutine.send(None)
        except StopIteration as end:
            return end.value
        time.sleep(0.01)


def test_await_in_an_executor_of_rclpy(buffer: tf2.Buffer) -> None:
    sender = send_when_someone_waits(buffer)
    got = drive(buffer.lookup_transform_async("map", "base", at(2)))
    sender.join()
    assert got.header.stamp == tf2.Time(2, 0)


def test_a_future_calls_back(buffer: tf2.Buffer) -> None:
    future = buffer.wait_for_transform_async("map", "base", at(2))
    called = threading.Event()
    future.add_done_callback(lambda _: called.set())
    assert not future.done()
    buffer.set_transform(link("map", "base", 2), "wheels")
    assert called.wait(30)
    assert future.result().header.stamp == tf2.Time(2, 0)
    assert future.exception() is None


def test_a_future_fails_at_once_where_no_write_can_help(buffer: tf2.Buffer) -> None:
    buffer.set_transform(link("map", "base", 100), "wheels")
    future = buffer.wait_for_transform_async("map", "base", at(50))
    with pytest.raises(tf2.ExtrapolationException):
        future.result(30)
    future = buffer.wait_for_transform_full_async("", at(50), "base", at(50), "map")
    with pytest.raises(tf2.InvalidArgumentException):
        future.result(30)


def test_a_cancelled_future_leaves_nothing_behind(buffer: tf2.Buffer) -> None:
    future = buffer.wait_for_transform_async("map", "base", at(2))
    wait_until(lambda: waiters(buffer))
    assert future.cancel()
    with pytest.raises(CancelledError):
        future.result()
    wait_until(lambda: not waiters(buffer))  # at the end of its round
    wait_until(lambda: "tf2 wait" not in {thread.name for thread in threading.enumerate()})


def test_closing_ends_the_waits(shim: Any) -> None:
    buffer = zenoh_tf_client.tf2.Buffer()
    future = buffer.wait_for_transform_async("map", "base", at(2))
    wait_until(lambda: waiters(buffer))
    tf2.close()
    with pytest.raises(tf2.TransformException):
        future.result(30)


def test_a_buffer_that_is_gone_leaves_no_thread() -> None:
    buffer = tf2.Buffer()
    future = buffer.wait_for_transform_async("map", "base", at(2))
    names = {"tf2 wait", "tf2 waits", "tf2 wakes"}
    wait_until(lambda: "tf2 wakes" in {thread.name for thread in threading.enumerate()})
    future.cancel()
    del buffer, future
    gc.collect()
    wait_until(lambda: not names & {thread.name for thread in threading.enumerate()})


def test_many_lookups_wait_on_two_threads() -> None:
    buffer, before = tf2.Buffer(), threading.active_count()
    futures = [
        buffer.wait_for_transform_async("map", f"base{number % 10}", at(2)) for number in range(200)
    ]
    wait_until(lambda: waiters(buffer) == len(futures))
    wait_until(lambda: threading.active_count() <= before + 2)
    for number in range(10):
        buffer.set_transform(link("map", f"base{number}", 2, (number, 0.0, 0.0)), "")
    found = [future.result(30).transform.translation.x for future in futures]
    assert found == [number % 10 for number in range(200)]


def test_a_future_with_a_wrong_argument(buffer: tf2.Buffer) -> None:
    with pytest.raises(TypeError):
        buffer.wait_for_transform_async("map", "base", "now")
    future = buffer.wait_for_transform_async("map", "base", tf2.Time(nanoseconds=2**70))
    with pytest.raises(tf2.InvalidArgumentException, match="stamp_ns"):
        future.result(30)


def test_a_future_beyond_a_gap_fails_at_once(buffer: tf2.Buffer) -> None:
    buffer.set_transform(link("map", "base", 5), "wheels")
    future = buffer.wait_for_transform_async("map", "base", at(3), max_gap_s=1.0)
    with pytest.raises(GapTooLong):
        future.result(30)
    full = buffer.wait_for_transform_full_async("map", at(3), "base", at(3), "map", max_gap_s=5.0)
    assert full.result(30).header.stamp == tf2.Time(3, 0)
