"""H: waiting for a transform. tf2's request handles and callbacks are lookups with a time-out."""

from __future__ import annotations

import threading
import time

import pytest

from zenoh_tf import (
    BackwardExtrapolationException,
    ExtrapolationException,
    LookupException,
    NoDataForExtrapolationException,
    StampedTransform,
    TimeoutException,
    TransformException,
)
from zenoh_tf_client import TransformClient

from .shorthand import Tree, assert_pose, can, look, ns, put, x_of
from .waits import LONG_S, SOON_S, asking, assert_at_once, assert_waits, settle


def wait_for(
    tf: Tree, target: str, source: str, seconds: float | None, timeout_s: float = LONG_S
) -> StampedTransform:
    stamp_ns = None if seconds is None else ns(seconds)
    return tf.lookup_transform(target, source, stamp_ns, timeout_s=timeout_s)


def test_H01_already_transformable(tf: Tree) -> None:
    """An answer that is available is returned at once, whatever the time-out."""
    put(tf, "a", "b", 1, (5, 0, 0))
    assert assert_at_once(lambda: wait_for(tf, "a", "b", 1)) == look(tf, "a", "b", 1)
    assert assert_at_once(lambda: wait_for(tf, "a", "b", None)) == look(tf, "a", "b")
    assert assert_at_once(lambda: tf.can_transform("a", "b", ns(1), timeout_s=LONG_S))
    full = tf.lookup_transform_full("a", ns(1), "b", ns(1), "a", timeout_s=LONG_S)
    assert_pose(full, (5, 0, 0))
    assert tf.stats()["waiters"] == 0


def test_H02_waits_for_a_new_transform(tf: Tree) -> None:
    """Of the samples that arrive in order, exactly the one that serves the time ends the wait."""
    put(tf, "a", "b", 0)
    with asking(tf, lambda: wait_for(tf, "a", "b", 10)) as answer:
        for seconds in range(1, 10):
            put(tf, "a", "b", seconds, (seconds, 0, 0))
            assert_waits(tf, answer)
        put(tf, "a", "b", 10, (10, 0, 0))
        result = answer.result(SOON_S)
    assert (result.parent_frame, result.child_frame, result.stamp_ns) == ("a", "b", ns(10))
    assert x_of(result) == 10
    assert tf.stats()["waiters"] == 0


def test_H03_waits_for_an_old_transform(tf: Tree) -> None:
    """The same for samples that arrive newest first."""
    put(tf, "a", "b", 10)
    with asking(tf, lambda: wait_for(tf, "a", "b", 1)) as answer:
        for seconds in range(9, 1, -1):
            put(tf, "a", "b", seconds, (seconds, 0, 0))
            assert_waits(tf, answer)
        put(tf, "a", "b", 1, (1, 0, 0))
        result = answer.result(SOON_S)
    assert (result.stamp_ns, x_of(result)) == (ns(1), 1)
    assert tf.stats()["waiters"] == 0


def test_H04_waits_for_frames_that_do_not_exist(tf: Tree) -> None:
    """A lookup can wait in an empty tree until the frames and the links between them appear."""
    with asking(tf, lambda: wait_for(tf, "foo", "bar", 1)) as answer:
        put(tf, "other", "frame", 1)
        assert_waits(tf, answer)
        put(tf, "foo", "bar", 1, (7, 0, 0))
        assert x_of(answer.result(SOON_S)) == 7
    put(tf, "far", "island", 1)
    with asking(tf, lambda: wait_for(tf, "foo", "island", None)) as answer:
        put(tf, "foo", "bar", 2)
        assert_waits(tf, answer)
        put(tf, "bar", "far", 1, (1, 0, 0))
        assert x_of(answer.result(SOON_S)) == pytest.approx(8)
    assert tf.stats()["waiters"] == 0


def test_H05_never(tf: Tree) -> None:
    """A time older than the cache can never be served: the wait fails before it begins."""
    put(tf, "a", "b", 20)
    with pytest.raises(NoDataForExtrapolationException) as caught:
        assert_at_once(lambda: wait_for(tf, "a", "b", 9))
    assert caught.value.stamp_ns == ns(9)
    assert not assert_at_once(lambda: tf.can_transform("a", "b", ns(9), timeout_s=LONG_S))
    with pytest.raises(ExtrapolationException):
        assert_at_once(
            lambda: tf.lookup_transform_full("a", ns(20), "b", ns(9), "a", timeout_s=LONG_S)
        )
    assert tf.stats()["waiters"] == 0
    with asking(tf, lambda: wait_for(tf, "a", "b", 10)) as answer:
        put(tf, "a", "b", 10, (1, 0, 0))
        assert x_of(answer.result(SOON_S)) == 1


def test_H06_expires(tf: Tree) -> None:
    """A wait that a newer sample makes impossible fails with that sample."""
    put(tf, "a", "b", 10)
    with asking(tf, lambda: wait_for(tf, "a", "b", 1)) as answer:
        put(tf, "a", "b", 11)
        assert_waits(tf, answer)
        put(tf, "a", "b", 12)
        error = answer.exception(SOON_S)
    assert type(error) is BackwardExtrapolationException
    assert (error.frame, error.stamp_ns, error.oldest_stamp_ns) == ("b", ns(1), ns(10))
    assert tf.stats()["waiters"] == 0


def test_H07_nothing_is_left_of_a_wait(tf: Tree) -> None:
    """A wait that has timed out, or whose client is gone, leaves nothing behind and is never
    answered. A known frame in itself needs no wait.
    [Q] Decision E06: an unknown frame in itself is a LookupException, so it is waited for."""
    for _ in range(3):
        with pytest.raises(LookupException):
            wait_for(tf, "foo", "bar", 1, timeout_s=0.02)
        assert not tf.can_transform("foo", "bar", ns(1), timeout_s=0.02)
    assert tf.stats()["waiters"] == 0
    if isinstance(tf, TransformClient):
        short_s = 2.0
        gone = TransformClient.connect(tf.endpoint)
        asker = threading.Thread(target=ask_in_vain, args=(gone, short_s))
        asker.start()
        settle(tf, 1)
        gone.close()
        asker.join(SOON_S)
        assert not asker.is_alive()
        settle(tf, 0)
    with asking(tf, lambda: wait_for(tf, "z", "z", 1)) as answer:
        put(tf, "foo", "bar", 1)
        assert_waits(tf, answer)
        put(tf, "foo", "z", 5)
        assert_pose(answer.result(SOON_S), (0, 0, 0))
    assert assert_at_once(lambda: wait_for(tf, "z", "z", 1)).stamp_ns == ns(1)
    assert tf.stats()["waiters"] == 0


def ask_in_vain(tf: Tree, timeout_s: float) -> None:
    with pytest.raises(TransformException):
        wait_for(tf, "foo", "bar", 1, timeout_s)


def test_H08_answer_or_time_out(tf: Tree) -> None:
    """A wait has one outcome: the transform if it arrives in time, else the error of the lookup.
    [Q] Decision: never TimeoutException. At the deadline it may be either, never both."""
    with asking(tf, lambda: wait_for(tf, "valid", "child", 1)) as answer:
        put(tf, "valid", "child", 1, (3, 0, 0))
        assert x_of(answer.result(SOON_S)) == 3

    begun_s = time.monotonic()
    with pytest.raises(LookupException) as caught:
        wait_for(tf, "timeout", "child", 1, timeout_s=0.1)
    assert time.monotonic() - begun_s >= 0.1
    assert not isinstance(caught.value, TimeoutException)
    put(tf, "timeout", "child", 1)  # too late for that wait
    assert tf.stats()["waiters"] == 0

    outcomes: list[float | None] = []
    for i in range(30):
        parent, timeout_s = f"race{i}", 0.01
        writer = threading.Timer(timeout_s, put, (tf, parent, f"{parent}/child", 1, (i, 0, 0)))
        writer.start()
        try:
            outcomes.append(x_of(wait_for(tf, parent, f"{parent}/child", 1, timeout_s)))
        except LookupException:
            outcomes.append(None)
        writer.join()
        assert outcomes[-1] in (None, i)
        assert x_of(look(tf, parent, f"{parent}/child", 1)) == i
        assert tf.stats()["waiters"] == 0


def test_H09_at_once_or_delayed(tf: Tree) -> None:
    """Every kind of lookup that waits returns at once, or with the next set that completes it."""
    put(tf, "map", "old", 1)
    questions = {
        "at": lambda: wait_for(tf, "map", "at", 2),
        "latest": lambda: wait_for(tf, "map", "latest", None),
        "can": lambda: tf.can_transform("map", "can", ns(2), timeout_s=LONG_S),
        "full": lambda: tf.lookup_transform_full(
            "map", ns(1), "full", ns(2), "map", timeout_s=LONG_S
        ),
        "fixed": lambda: tf.lookup_transform_full(
            "old", ns(1), "old", ns(1), "fixed", timeout_s=LONG_S
        ),
    }
    for child, question in questions.items():
        with asking(tf, question) as answer:
            put(tf, "map", child, 1.5, static=child == "fixed")
            if child in ("latest", "fixed"):
                answer.result(SOON_S)
                continue
            assert_waits(tf, answer)
            put(tf, "map", child, 2)
            delayed = answer.result(SOON_S)
        assert assert_at_once(question) == delayed
    assert tf.stats()["waiters"] == 0


def test_H10_no_thread_is_needed(tf: Tree) -> None:
    """[Q] Decision: the write wakes the waiting lookups, so no extra thread has to run. A tree
    without writes answers too: at once without a time-out, else when it has expired."""
    put(tf, "foo", "bar", 1)
    assert can(tf, "foo", "bar", 1)
    threads = {*threading.enumerate()}
    assert tf.can_transform("foo", "bar", ns(1), timeout_s=LONG_S) is True
    assert tf.can_transform("foo", "bar", ns(2), timeout_s=0.05) is False
    with pytest.raises(NoDataForExtrapolationException, match="waited"):
        wait_for(tf, "foo", "bar", 2, timeout_s=0.05)
    assert {*threading.enumerate()} <= threads  # those of an earlier test may end
