"""What a buffer with a tree of its own has beside what `test_buffer` and others ask of both."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zenoh_tf_client.tf2
from tests.support.waiting import wait_until
from zenoh_tf import tf2
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings import RecordingError
from zenoh_tf.recordings.writer import RecordingWriter
from zenoh_tf.tf2.messages import stamped_of

from .conftest import FAKE_ROS, waiters
from .messages import at, lasting, link
from .test_scripts import AS_WRITTEN_FOR_TF2


@pytest.fixture
def buffer() -> tf2.Buffer:
    """map -> base with x = 10 t at 1, 2, 3 and 6 s; base -> arm at 2 and 8 s."""
    buffer = tf2.Buffer()
    for seconds in (1, 2, 3, 6):
        buffer.set_transform(link("map", "base", seconds, (10.0 * seconds, 0.0, 0.0)), "wheels")
    for seconds in (2, 8):
        buffer.set_transform(link("base", "arm", seconds), "joints")
    return buffer


def x_of(found: tf2.TransformStamped) -> float:
    return found.transform.translation.x


# --- times


@pytest.mark.parametrize("zero", [0, 0.0, -0.0, tf2.Time(), np.float64(0.0)])
def test_zero_in_every_form_is_the_latest_time(buffer: tf2.Buffer, zero: Any) -> None:
    assert buffer.lookup_transform("map", "base", zero).header.stamp == tf2.Time(6)


@pytest.mark.parametrize("time", [2, 2.0, np.float64(2.0), np.float32(2.0), np.int64(2)])
def test_numbers_are_seconds(buffer: tf2.Buffer, time: Any) -> None:
    assert x_of(buffer.lookup_transform("map", "base", time, time)) == 20.0
    assert buffer.can_transform("map", "base", time, timeout=time)
    full = buffer.lookup_transform_full("map", time, "base", time, "map", time)
    assert x_of(full) == 20.0
    assert x_of(buffer.wait_for_transform_async("map", "base", time).result(30)) == 20.0


def test_seconds_since_1970_are_rounded_to_nanoseconds() -> None:
    buffer = tf2.Buffer()
    buffer.set_transform(link("map", "base", 1_700_000_000.25), "")
    assert buffer.can_transform("map", "base", 1_700_000_000.25)


@pytest.mark.parametrize("time", [1_700_000_000_000_000_000, 1e30, float("nan"), float("inf")])
def test_numbers_that_cannot_be_seconds(buffer: tf2.Buffer, time: Any) -> None:
    with pytest.raises(tf2.InvalidArgumentException, match="nanoseconds"):
        buffer.lookup_transform("map", "base", time)


def test_a_time_out_that_is_no_number(buffer: tf2.Buffer) -> None:
    with pytest.raises(tf2.InvalidArgumentException, match=r"^timeout must be "):
        buffer.lookup_transform("map", "base", 2.0, float("nan"))
    with pytest.raises(TypeError):
        buffer.lookup_transform("map", "base", 2.0, "long")


@pytest.mark.parametrize("cache_time", [lasting(2), tf2.Duration(2), 2, 2.0])
def test_the_cache_time(cache_time: Any) -> None:
    buffer = tf2.Buffer(cache_time)
    for seconds in (1, 2, 3, 4):
        buffer.set_transform(link("map", "base", seconds), "")
    assert buffer.can_transform("map", "base", at(2))
    assert not buffer.can_transform("map", "base", at(1))


def test_the_cache_time_of_tf2() -> None:
    buffer = tf2.Buffer()
    for seconds in (1, 2, 11.5):
        buffer.set_transform(link("map", "base", seconds), "")
    assert buffer.can_transform("map", "base", at(2))
    assert not buffer.can_transform("map", "base", at(1))


# --- gaps, and the nearest time


def test_a_gap(buffer: tf2.Buffer) -> None:
    assert x_of(buffer.lookup_transform("map", "base", 4.0)) == 40.0
    message = tf2.PointStamped(tf2.Header(tf2.Time(4), "base"))
    for ask in (
        lambda: buffer.lookup_transform("map", "base", 4.0, max_gap_s=2.0),
        lambda: buffer.lookup_transform_full("map", 4.0, "base", 4.0, "map", max_gap_s=2.0),
        lambda: buffer.transform(message, "map", max_gap_s=2.0),
        lambda: buffer.transform_full(message, "map", 4.0, "map", max_gap_s=2.0),
    ):
        with pytest.raises(tf2.ExtrapolationException, match="gap"):
            ask()
    assert not buffer.can_transform("map", "base", 4.0, max_gap_s=2.0)
    assert not buffer.can_transform_full("map", 4.0, "base", 4.0, "map", max_gap_s=2.0)
    assert buffer.can_transform("map", "base", 4.0, max_gap_s=3.0)


def test_a_gap_of_all_lookups() -> None:
    buffer = tf2.Buffer(max_gap_s=2.0)
    for seconds in (3, 6):
        buffer.set_transform(link("map", "base", seconds), "")
    assert not buffer.can_transform("map", "base", 4.0)
    assert buffer.can_transform("map", "base", 4.0, max_gap_s=3.0)


#: Frame, time, limit of gaps, tolerance, and the time that is used; None: the lookup fails.
NEAREST = [
    ("base", 4.0, None, 0.5, 4.0),  # there is data
    ("base", 6.5, None, 0.5, 6.0),
    ("base", 6.5, None, 0.4, None),
    ("base", 0.5, None, 0.5, 1.0),
    ("base", 0.5, None, 0.4, None),
    ("base", 4.0, 2.0, 1.5, 3.0),  # the nearer end of the gap
    ("base", 5.0, 2.0, 1.5, 6.0),
    ("base", 4.5, 2.0, 1.4, None),
    ("base", 4.5, 2.0, 1.5, 3.0),
    ("arm", 1.0, None, 1.0, 2.0),  # base has data for 1 s, arm from 2 s on
    ("arm", 9.0, None, 5.0, 6.0),  # arm has data until 8 s, base until 6 s
    ("arm", 9.0, None, 2.5, None),
    ("arm", 4.0, 2.0, 5.0, 2.0),  # base from 3 s, but arm has nothing between 2 s and 8 s
    ("arm", 4.0, 2.0, 1.5, None),
]


@pytest.mark.parametrize(("frame", "time", "gap", "nearest", "used"), NEAREST)
def test_the_nearest_time(
    buffer: tf2.Buffer, frame: str, time: float, gap: Any, nearest: float, used: float | None
) -> None:
    options = {"max_gap_s": gap, "nearest_s": nearest}
    possible = buffer.can_transform("map", frame, time, **options)
    assert possible is (used is not None)
    message = tf2.PointStamped(tf2.Header(tf2.Time(seconds=time), frame))
    if used is not None:
        got = buffer.lookup_transform("map", frame, time, **options)
        assert (got.header.stamp, x_of(got)) == (tf2.Time(seconds=used), 10 * used)
        assert buffer.transform(message, "map", **options).point.x == 10 * used
        return
    with pytest.raises(tf2.ExtrapolationException) as raised:
        buffer.lookup_transform("map", frame, time, **options)
    assert raised.value.stamp_ns == tf2.Time(seconds=time).nanoseconds  # of the time asked for


def test_the_nearest_time_where_links_have_none_in_common() -> None:
    buffer = tf2.Buffer()
    buffer.set_transform(link("map", "base", 1), "")
    buffer.set_transform(link("base", "arm", 2), "")
    assert not buffer.can_transform("map", "arm", 1.5, nearest_s=9)
    assert not buffer.can_transform("map", "arm", 0, nearest_s=9)


def test_the_nearest_times_of_a_lookup_at_two(buffer: tf2.Buffer) -> None:
    """The pose of the base at 6.5 s in the base at 0.5 s, by its samples at 6 s and 1 s."""
    lookup = "base", 0.5, "base", 6.5, "map"
    got = buffer.lookup_transform_full(*lookup, nearest_s=0.5)
    assert (got.header.stamp, x_of(got)) == (tf2.Time(1), 50.0)
    message = tf2.PointStamped(tf2.Header(tf2.Time(seconds=6.5), "base"))
    assert buffer.transform_full(message, "base", 0.5, "map", nearest_s=0.5).point.x == 50.0
    assert buffer.lookup_transform_full("base", 0.5, "base", 0, "map", nearest_s=0.5)
    with pytest.raises(tf2.ExtrapolationException):
        buffer.lookup_transform_full(*lookup)
    with pytest.raises(tf2.ExtrapolationException):
        buffer.lookup_transform_full(*lookup, nearest_s=0.4)
    assert not buffer.can_transform_full(*lookup, nearest_s=0.4)


def test_the_nearest_time_at_a_server(shim: Any) -> None:
    buffer = zenoh_tf_client.tf2.Buffer()
    buffer.set_transform(link("map", "base", 1, (1.0, 0.0, 0.0)), "")
    got = buffer.lookup_transform("map", "base", 1.5, nearest_s=0.5)
    assert (got.header.stamp, x_of(got)) == (tf2.Time(1), 1.0)


def test_the_nearest_time_is_used_after_the_time_out(buffer: tf2.Buffer) -> None:
    def write() -> None:
        wait_until(lambda: waiters(buffer))
        buffer.set_transform(link("map", "base", 7, (70.0, 0.0, 0.0)), "wheels")

    writer = threading.Thread(target=write)
    writer.start()
    assert x_of(buffer.lookup_transform("map", "base", 7.0, 30.0, nearest_s=5.0)) == 70.0
    writer.join()
    assert x_of(buffer.lookup_transform("map", "base", 7.5, 0.01, nearest_s=5.0)) == 70.0


@pytest.mark.parametrize("nearest", [-1.0, float("nan"), "near"])
def test_what_is_no_tolerance(buffer: tf2.Buffer, nearest: Any) -> None:
    with pytest.raises(tf2.InvalidArgumentException, match="nearest_s"):
        buffer.lookup_transform("map", "base", 2.0, nearest_s=nearest)
    with pytest.raises(tf2.InvalidArgumentException, match="nearest_s"):
        buffer.lookup_transform_full("base", 1.0, "base", 2.0, "map", nearest_s=nearest)


# --- recordings


def test_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, {})
    for seconds in range(101):
        base = stamped_of(link("map", "base", seconds + 1, (10.0 * (seconds + 1), 0.0, 0.0)))
        writer.write(base.stamp_ns, False, TransformRows.of([base]))
    writer.write(1, True, TransformRows.of([stamped_of(link("base", "camera", 0))]))
    writer.close()
    buffer = tf2.Buffer.from_recording(path)
    assert x_of(buffer.lookup_transform("map", "base", 60.0)) == 600.0  # a minute is kept
    assert buffer.can_transform("base", "camera", 5.0)
    strict = tf2.Buffer.from_recording(path, max_gap_s=0.5)
    assert not strict.can_transform("map", "base", 60.5)
    with pytest.raises(RecordingError):
        tf2.Buffer.from_recording(path, topics="/other")
    with pytest.raises(RecordingError):
        tf2.Buffer.from_recording(tmp_path / "none.mcap")


# --- which tree


def test_connect_decides_for_what_is_made_later(
    shared_server: Any, process_topics: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ZENOH_TF_CONNECT", shared_server.endpoint)
    own = tf2.Buffer()
    try:
        assert not own.is_on_server  # the environment alone changes nothing
        client = tf2.connect(shared_server.endpoint)
        client.clear(keep_static=False)
        on_server = tf2.Buffer()
        assert on_server.is_on_server
        assert not own.is_on_server
        tf2.TransformListener(on_server)
        tf2.TransformBroadcaster().sendTransform(link("map", "base", 1))
        assert on_server.can_transform("map", "base", at(1), lasting(30))
        assert client.can_transform("map", "base")
        assert own.all_frames_as_string() == ""
        assert type(on_server) is type(own)
    finally:
        tf2.close()
    assert not tf2.Buffer().is_on_server
    assert zenoh_tf_client.tf2.Buffer().is_on_server
    assert tf2.BufferClient().is_on_server


# --- scripts


def run(script: str, *folders: Path) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
        env={"PYTHONPATH": ":".join(map(str, folders)), "ZENOH_TF_CONNECT": "tcp/127.0.0.1:1"},
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return done.stdout.splitlines()


def test_a_script_for_tf2_with_another_import_line_needs_no_server() -> None:
    script = AS_WRITTEN_FOR_TF2.replace("from tf2_ros import", "from zenoh_tf.tf2 import")
    lines = run(script + "\nimport sys\nprint('zenoh' in sys.modules)", FAKE_ROS)
    assert lines == [
        *(
            line
            for step in (0.0, 1.0, 2.0)
            for line in (
                "not yet: LookupException",
                f"camera at {step} 0.0 0.5, 0 ns old",
                f"point at {step + 1.0} 0.0 0.5",
            )
        ),
        "False",
    ]


def test_neither_zenoh_nor_the_sdk_nor_ros_is_imported() -> None:
    lines = run(
        "import sys\n"
        "from zenoh_tf.tf2 import *\n"
        "buffer = Buffer()\n"
        "TransformListener(buffer)\n"
        "TransformBroadcaster().sendTransform(TransformStamped(Header(Time(1), 'a'), 'b'))\n"
        "buffer.wait_for_transform_async('a', 'b', Time(1)).result(30)\n"
        "print(sorted({n.split('.')[0] for n in sys.modules} & {'zenoh', 'zenoh_tf_client',"
        "'zenoh_tf_server', 'msgpack', 'uvloop', 'rclpy', 'tf2_ros', 'geometry_msgs'}))",
        FAKE_ROS,
    )
    assert lines == ["[]"]


def test_the_modules_have_tf2_ros_names() -> None:
    from zenoh_tf.tf2.buffer import Buffer  # noqa: PLC0415
    from zenoh_tf.tf2.buffer_client import BufferClient  # noqa: PLC0415
    from zenoh_tf.tf2.static_transform_broadcaster import (  # noqa: PLC0415
        StaticTransformBroadcaster,
    )
    from zenoh_tf.tf2.transform_broadcaster import TransformBroadcaster  # noqa: PLC0415
    from zenoh_tf.tf2.transform_listener import TransformListener  # noqa: PLC0415

    kinds = (
        Buffer,
        BufferClient,
        StaticTransformBroadcaster,
        TransformBroadcaster,
        TransformListener,
    )
    for kind in kinds:
        assert getattr(tf2, kind.__name__) is kind


def test_the_old_names_of_modules_remain() -> None:
    from zenoh_tf_client.tf2.messages import stamped_of as stamped  # noqa: PLC0415
    from zenoh_tf_client.tf2.times import Time  # noqa: PLC0415
    from zenoh_tf_client.tf2.transforming import do_transform_point  # noqa: PLC0415

    assert stamped is stamped_of
    assert (Time, do_transform_point) == (tf2.Time, tf2.do_transform_point)
    assert set(zenoh_tf_client.tf2.__all__) == set(tf2.__all__)


ENDS_WITH_WAITS = """
from zenoh_tf.tf2 import Buffer, Header, MessageFilter, Time, TransformStamped

buffer = Buffer()
held = MessageFilter(None, buffer, "never", 10)
held.add(TransformStamped(Header(Time(1), "port"), "ship"))
waits = [buffer.wait_for_transform_async("port", "never", Time()) for _ in range(3)]
"""

WAITS_AFTER_A_FORK = """
import os, warnings
from zenoh_tf.tf2 import Buffer, Header, Time, TransformStamped

# Python 3.12 warns of every fork beside threads.
warnings.simplefilter("ignore", DeprecationWarning)
buffer = Buffer()
buffer.set_transform(TransformStamped(Header(Time(1), "port"), "ship"), "")
buffer.wait_for_transform_async("port", "ship", Time()).result(30)
child = os.fork()
if child:
    raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
future = buffer.wait_for_transform_async("port", "ship", Time(2))
buffer.set_transform(TransformStamped(Header(Time(3), "port"), "ship"), "")
print(future.result(30).header.stamp.sec, flush=True)
os._exit(0)
"""


def test_a_script_may_end_at_any_time() -> None:
    assert run(ENDS_WITH_WAITS) == []


def test_a_forked_process_waits_by_itself() -> None:
    assert run(WAITS_AFTER_A_FORK) == ["2"]
