"""Message filters: messages wait in a buffer's own tree, or at a real server, for transforms."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.support.waiting import wait_until
from zenoh_tf.errors import LimitExceeded, ServerUnavailable, WrongType
from zenoh_tf.tf2 import Buffer, FilterFailureReason, MessageFilter, TransformFilter
from zenoh_tf_client import tf2
from zenoh_tf_client.client import TransformClient

from .conftest import waiters
from .fake_ros.geometry_msgs import msg
from .messages import at, lasting, link

Calls = list[tuple[Any, ...]]


def point(seconds: float, frame: str = "base") -> msg.PointStamped:
    message = msg.PointStamped()
    message.header.frame_id = frame
    message.header.stamp = at(seconds).to_msg()
    return message


def move(buffer: Buffer, seconds: float, child: str = "base") -> None:
    buffer.set_transform(link("map", child, seconds, (seconds, 0.0, 0.0)), "wheels")


@pytest.fixture
def calls() -> Calls:
    """What the filter's callbacks were called with."""
    return []


@pytest.fixture
def make(buffer: Buffer, calls: Calls) -> Iterator[Callable[..., TransformFilter]]:
    """``make(kind, target, size)``: a filter whose callbacks record their arguments."""
    made: list[TransformFilter] = []

    def filter_of(
        kind: type[TransformFilter] = TransformFilter,
        target: Any = "map",
        size: int = 10,
        **options: Any,
    ) -> TransformFilter:
        held = kind(None, buffer, target, size, **options)
        held.registerCallback(lambda *arguments: calls.append(arguments))
        held.registerFailureCallback(lambda *arguments: calls.append(arguments))
        made.append(held)
        return held

    yield filter_of
    for one in made:
        one.close()


def test_a_message_waits_for_its_transform(buffer: Buffer, make: Any, calls: Calls) -> None:
    held, late, early = make(), point(3), point(2)
    held.add(late)
    held.add(early)
    wait_until(lambda: waiters(buffer) == 2)
    assert (held.stats()["held"], calls) == (2, [])
    move(buffer, 2)
    wait_until(lambda: calls)
    move(buffer, 3)
    wait_until(lambda: len(calls) == 2)
    assert [call[0] for call in calls] == [early, late]  # in the order of their transforms
    for message, transform in calls:
        assert transform.header.stamp.nanoseconds == at(message.header.stamp.sec).nanoseconds
        assert transform.transform.translation.x == message.header.stamp.sec
        assert (transform.header.frame_id, transform.child_frame_id) == ("map", "base")
    counts = held.stats()
    assert (counts["received"], counts["passed"], counts["held"]) == (2, 2, 0)


def test_nothing_waits_for_what_is_there(buffer: Buffer, make: Any, calls: Calls) -> None:
    held, message = make(MessageFilter), point(1)
    held.registerCallback(lambda *arguments: calls.append(arguments), "more", 5)
    held.add(message)
    wait_until(lambda: len(calls) == 2)
    assert calls == [(message,), (message, "more", 5)]


def test_a_full_queue_drops_the_oldest_and_its_wait(
    buffer: Buffer, make: Any, calls: Calls
) -> None:
    held = make(size=3)
    messages = [point(seconds) for seconds in range(2, 7)]
    for message in messages:
        held.add(message)
    assert [call[:2] for call in calls] == [
        (message, FilterFailureReason.QUEUE_FULL) for message in messages[:2]
    ]
    error = calls[0][2]
    assert type(error) is LimitExceeded
    assert (error.field, error.limit) == ("queue_size", 3)
    wait_until(lambda: waiters(buffer) == 3)  # the server forgets the others
    calls.clear()
    move(buffer, 10)
    wait_until(lambda: len(calls) == 3)
    assert {id(call[0]) for call in calls} == {id(message) for message in messages[2:]}
    assert held.stats()["queue_full"] == 2


def test_a_slow_callback_fills_the_queue(buffer: Buffer, calls: Calls) -> None:
    """Messages that are ready count as held, too: nothing grows."""
    go, entered = threading.Event(), threading.Event()

    def slow(*arguments: Any) -> None:
        entered.set()
        go.wait(30)
        calls.append(arguments)

    with MessageFilter(None, buffer, "map", 2) as held:
        held.registerCallback(slow)
        held.add(point(1))
        assert entered.wait(30)
        messages = [point(1) for _ in range(50)]
        for message in messages:
            held.add(message)
        assert held.stats()["held"] == 2
        go.set()
        wait_until(lambda: held.stats()["passed"] == 3)
        assert held.stats()["queue_full"] == 48


def test_several_target_frames(buffer: Buffer, make: Any, calls: Calls) -> None:
    buffer.set_transform_static(link("base", "camera", 0, (0.0, 0.0, 1.0)), "urdf")
    held, message = make(target=["map", "odom"]), point(2, "camera")
    held.add(message)
    move(buffer, 2)
    wait_until(lambda: waiters(buffer) == 1)
    assert calls == []
    move(buffer, 2, "odom")
    wait_until(lambda: calls)
    [(got, transforms)] = calls
    assert got is message
    assert [transform.header.frame_id for transform in transforms] == ["map", "odom"]


#: Samples of the base, a message's time and frame, why it is dropped, and the error.
REFUSED: list[tuple[tuple[float, ...], float, Any, str, type[Exception], str]] = [
    ((100,), 50, "base", "OUT_THE_BACK", tf2.NoDataForExtrapolationException, "'base'"),
    ((100, 101), 50, "base", "OUT_THE_BACK", tf2.BackwardExtrapolationException, "'base'"),
    ((), 1, "", "EMPTY_FRAME_ID", tf2.InvalidArgumentException, "no frame"),
    ((), 1, 5, "UNKNOWN", WrongType, "must be a str"),
    ((), 1, "/base", "UNKNOWN", tf2.InvalidArgumentException, "/base"),
]


@pytest.mark.parametrize(("samples_s", "seconds", "frame", "reason", "error", "text"), REFUSED)
def test_what_cannot_come_is_dropped_at_once(
    buffer: Buffer,
    make: Any,
    calls: Calls,
    samples_s: Any,
    seconds: float,
    frame: Any,
    reason: str,
    error: type[Exception],
    text: str,
) -> None:
    for sample_s in samples_s:
        move(buffer, sample_s)
    held, message = make(), point(seconds, frame)
    held.add(message)
    wait_until(lambda: calls)
    [(got, given, raised)] = calls
    assert (got, given, type(raised)) == (message, FilterFailureReason[reason], error)
    assert text in str(raised)
    assert held.stats()[reason.lower()] == 1


def test_what_is_no_message_is_the_callers_error(make: Any) -> None:
    held = make()
    for message in (None, msg.PointStamped(header=msg.Header(stamp="now", frame_id="base"))):
        with pytest.raises((AttributeError, TypeError)):
            held.add(message)
    assert held.stats()["received"] == held.stats()["held"] == 0


def test_a_time_out(buffer: Buffer, make: Any, calls: Calls) -> None:
    held, message = make(buffer_timeout=lasting(0.05)), point(2)
    held.add(message)
    wait_until(lambda: calls)
    assert calls[0][:2] == (message, FilterFailureReason.NO_TRANSFORM_FOUND)
    assert type(calls[0][2]) is tf2.NoDataForExtrapolationException


class Subscriber:
    """As message_filters.Subscriber: what it calls back."""

    def __init__(self) -> None:
        self.callbacks: list[tuple[Callable[..., object], tuple[Any, ...]]] = []

    def registerCallback(self, callback: Callable[..., object], *arguments: Any) -> int:
        self.callbacks.append((callback, arguments))
        return len(self.callbacks) - 1

    def receive(self, message: Any) -> None:
        for callback, arguments in self.callbacks:
            callback(message, *arguments)


def test_filters_in_a_row(buffer: Buffer, calls: Calls) -> None:
    """A subscriber, then the one filter, then the other."""
    subscriber, message = Subscriber(), point(1)
    first = MessageFilter(subscriber, buffer, "map", 5)
    second = TransformFilter(first, buffer, "base", 5, object(), lasting(30))
    with first, second:
        second.registerCallback(lambda *arguments: calls.append(arguments))
        subscriber.receive(message)
        wait_until(lambda: calls)
    assert calls[0][0] is message
    assert calls[0][1].header.frame_id == "base"


def test_a_callback_that_fails(
    buffer: Buffer, make: Any, calls: Calls, caplog: pytest.LogCaptureFixture
) -> None:
    held = make()
    held.registerCallback(lambda *_: 1 / 0)
    held.add(point(1))
    held.add(point(1))
    wait_until(lambda: held.stats()["callback_errors"] == 2)
    assert held.stats()["passed"] == 2
    assert "ZeroDivisionError" in caplog.text


def test_clear_and_close_leave_nothing_behind(buffer: Buffer, make: Any, calls: Calls) -> None:
    held = make()
    held.add(point(2))
    wait_until(lambda: waiters(buffer))
    held.clear()
    wait_until(lambda: not waiters(buffer))
    held.add(point(3))
    wait_until(lambda: waiters(buffer))
    held.close()
    held.close()
    held.add(point(1))
    wait_until(lambda: not waiters(buffer))
    move(buffer, 4)
    assert (held.stats()["held"], calls) == (0, [])


def test_the_filters_thread_ends(buffer: Buffer) -> None:
    with MessageFilter(None, buffer, "map", 5):
        pass
    wait_until(lambda: "tf2 filter" not in {thread.name for thread in threading.enumerate()})


def test_a_closed_connection_drops_what_is_held(shim: TransformClient, calls: Calls) -> None:
    buffer, message = tf2.Buffer(), point(2)
    move(buffer, 1)
    held = TransformFilter(None, buffer, "map", 10)
    held.registerCallback(lambda *arguments: calls.append(arguments))
    held.registerFailureCallback(lambda *arguments: calls.append(arguments))
    held.add(message)
    wait_until(lambda: shim.stats()["waiters"])
    tf2.close()
    wait_until(lambda: calls)
    assert calls[0][:2] == (message, FilterFailureReason.UNKNOWN)
    assert type(calls[0][2]) is ServerUnavailable
    calls.clear()
    held.add(point(1))  # opens the connection again
    wait_until(lambda: calls)
    assert calls[0][1].header.frame_id == "map"
    held.close()


def test_messages_outlive_a_server(start_server: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = start_server()
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    buffer, calls = tf2.Buffer(), []
    move(buffer, 1)
    with TransformFilter(None, buffer, "map", 5) as held:
        held.registerCallback(lambda *arguments: calls.append(arguments))
        held.add(point(2))
        wait_until(lambda: tf2.connect().stats()["waiters"])
        server.kill()
        start_server(endpoint=server.endpoint)
        with server.connect() as tf:
            tf.set_transforms_xact([_stamped(seconds) for seconds in (1, 3)])
            wait_until(lambda: calls)
    tf2.close()
    assert calls[0][1].header.stamp.sec == 2


def _stamped(seconds: float) -> Any:
    from zenoh_tf.tf2.messages import stamped_of  # noqa: PLC0415

    return stamped_of(link("map", "base", seconds))


def test_a_queue_without_room_is_refused(buffer: Buffer) -> None:
    with pytest.raises(tf2.InvalidArgumentException) as refusal:
        MessageFilter(None, buffer, "map", 0)
    assert refusal.value.field == "queue_size"


def test_many_messages_wait_on_two_threads(buffer: Buffer, make: Any, calls: Calls) -> None:
    held = make(size=1000)
    before = threading.active_count()
    for number in range(1000):
        held.add(point(2 + number / 1000))
    wait_until(lambda: waiters(buffer) == 1000)
    assert threading.active_count() <= before + 2
    move(buffer, 4)
    wait_until(lambda: len(calls) == 1000)


def test_an_error_that_no_lookup_should_raise(
    make: Any, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr("zenoh_tf.tf2.message_filter._look_up", fail)
    held, message = make(), point(2)
    held.add(message)
    wait_until(lambda: calls)
    assert calls[0][:2] == (message, FilterFailureReason.UNKNOWN)
    assert "boom" in str(calls[0][2])
    assert held.stats()["held"] == 0


def test_a_callback_cannot_end_the_filter(buffer: Buffer, make: Any, calls: Calls) -> None:
    """`sys.exit` would end the filter's thread only."""

    def leave(*_: object) -> None:
        raise SystemExit

    held = make()
    held.registerCallback(leave)
    held.add(point(1))
    wait_until(lambda: held.stats()["callback_errors"] == 1)
    held.add(point(1))
    wait_until(lambda: len(calls) == 2)
