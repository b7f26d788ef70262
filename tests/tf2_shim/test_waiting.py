"""Lookups that wait: with a time-out, as futures under asyncio, as rclpy's executors await."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import CancelledError
from typing import Any

import pytest

from tests.support.waiting import wait_until
from zenoh_tf_client import tf2
from zenoh_tf_client.client import TransformClient

from .messages import LATEST, at, lasting, link


def when_someone_waits(shim: TransformClient, action: Callable[[], None]) -> threading.Thread:
    def run() -> None:
        wait_until(lambda: shim.stats()["waiters"])
        action()

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
def test_a_wait_ends_with_the_write(shim: TransformClient, buffer: tf2.Buffer, name: str) -> None:
    sender = when_someone_waits(
        shim, lambda: buffer.set_transform(link("map", "base", 2), "wheels")
    )
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


def test_await_what_comes_later(shim: TransformClient, buffer: tf2.Buffer) -> None:
    async def both() -> tuple[tf2.TransformStamped, tf2.TransformStamped]:
        return await asyncio.gather(
            buffer.lookup_transform_async("map", "base", at(2)),
            buffer.lookup_transform_full_async("map", at(2), "base", at(2), "map"),
        )

    sender = when_someone_waits(
        shim, lambda: buffer.set_transform(link("map", "base", 2), "wheels")
    )
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


def test_await_in_an_executor_of_rclpy(shim: TransformClient, buffer: tf2.Buffer) -> None:
    sender = when_someone_waits(
        shim, lambda: buffer.set_transform(link("map", "base", 2), "wheels")
    )
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


def test_a_cancelled_future_leaves_nothing_behind(
    shim: TransformClient, buffer: tf2.Buffer
) -> None:
    future = buffer.wait_for_transform_async("map", "base", at(2))
    wait_until(lambda: shim.stats()["waiters"])
    assert future.cancel()
    with pytest.raises(CancelledError):
        future.result()
    wait_until(lambda: not shim.stats()["waiters"])  # at the end of its round
    wait_until(lambda: "tf2 wait" not in {thread.name for thread in threading.enumerate()})


def test_closing_ends_the_waits(shim: TransformClient, buffer: tf2.Buffer) -> None:
    future = buffer.wait_for_transform_async("map", "base", at(2))
    wait_until(lambda: shim.stats()["waiters"])
    tf2.close()
    with pytest.raises(tf2.TransformException):
        future.result(30)
