"""Sweeps of lidars as drivers send them: lost columns, offsets, and gaps of the motion."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.processes.servers import ServerProcess
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf.errors import (
    BackwardExtrapolationException,
    ExtrapolationException,
    ForwardExtrapolationException,
    GapTooLong,
)

S: Final = 10**9
BEGIN: Final = 1_700_000_000 * S
COLUMNS: Final = 1024
STEP: Final = 97_600  # ns between two columns


def drive(tree: Any, begin_s: float = -1, end_s: float = 1, rate_hz: int = 50) -> Any:
    """A lidar that drives by 2 m/s and turns by 0.5 rad/s."""
    step = S // rate_hz
    stamps = range(BEGIN + round(begin_s * S), BEGIN + round(end_s * S) + 1, step)
    tree.set_transforms_xact([pose(stamp) for stamp in stamps])
    return tree


def pose(stamp: int) -> StampedTransform:
    seconds = (stamp - BEGIN) / S
    turn = (0, 0, np.sin(0.25 * seconds), np.cos(0.25 * seconds))
    return StampedTransform("odom", "os_lidar", stamp, Transform((2 * seconds, 0, 0), turn))


def sweep(rows: int = 4) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(rows, columns, 3) points, and the offset of each column."""
    points = np.random.default_rng(3).normal(size=(rows, COLUMNS, 3)) * 20
    return points, STEP * np.arange(COLUMNS, dtype=np.int64)


AT: Final = BEGIN + STEP * (COLUMNS - 1)


@pytest.mark.parametrize("column", [12, 0, COLUMNS - 1])
@pytest.mark.parametrize("bad", ["nan", "zero"])
def test_a_lost_column_has_the_stamp_0(column: int, bad: str) -> None:
    """ouster-lidar/ouster-ros#350 and #499: one column of 1,024 has stamp 0 among 1.7e18; the
    others are deskewed, and the lost one becomes NaN or stays as it was, as the mask says."""
    tree = drive(TransformTree())
    points, offsets = sweep()
    expected = tree.deskew(points, BEGIN + offsets, "os_lidar", "odom", AT)
    points[:, column] = np.nan if bad == "nan" else 0
    stamps = BEGIN + offsets
    stamps[column] = 0
    others = np.arange(COLUMNS) != column
    ok = np.zeros(points.shape[:2], bool)
    cloud = tree.deskew(points, stamps, "os_lidar", "odom", AT, ok=ok)
    np.testing.assert_allclose(cloud[:, others], expected[:, others], rtol=0, atol=1e-9)
    assert np.isnan(cloud[:, column]).all()
    assert np.array_equal(ok, np.broadcast_to(others, ok.shape))
    raw = tree.deskew(points, stamps, "os_lidar", "odom", AT, missing="raw")
    np.testing.assert_array_equal(raw[:, column], points[:, column])
    np.testing.assert_array_equal(raw[:, others], cloud[:, others])
    in_place = points.copy()
    tree.deskew(in_place, stamps, "os_lidar", "odom", AT, missing="raw", out=in_place)
    np.testing.assert_array_equal(in_place, raw)
    with pytest.raises(BackwardExtrapolationException):
        tree.deskew(points, stamps, "os_lidar", "odom", AT, strict=True)


@pytest.mark.parametrize("kind", [np.uint32, np.int64])
@pytest.mark.parametrize("first", [49_416_704, -30_000_000])
def test_offsets(kind: Any, first: int) -> None:
    """ouster-lidar/ouster-ros#350, #46 and ros-drivers/velodyne#402: offsets from the begin of the
    sweep, negative ones, those that wrapped round to 4.29 s, and 0 for a lost column."""
    tree = drive(TransformTree())
    points, offsets = sweep(rows=2)
    offsets = first + offsets // 256  # 0.39 ms in all
    expected = tree.deskew(points, BEGIN + offsets, "os_lidar", "odom", AT)
    sent = (offsets % (1 << 32)).astype(kind) if kind is np.uint32 else offsets.copy()
    frames = ("os_lidar", "odom", AT)
    got = tree.deskew(points, sent, *frames, begin_ns=BEGIN)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    sent[12] = 0
    others = np.arange(COLUMNS) != 12
    ok = np.zeros(points.shape[:2], bool)
    got = tree.deskew(points, sent, *frames, begin_ns=BEGIN, ok=ok)
    np.testing.assert_allclose(got[:, others], expected[:, others], rtol=0, atol=1e-9)
    assert np.isnan(got[:, 12]).all()
    assert np.array_equal(ok[0], others)


@pytest.mark.parametrize("kind", [np.uint32, np.int64, np.uint64])
def test_one_offset_that_wrapped(kind: Any) -> None:
    """ouster-lidar/ouster-ros#46: the first points are a little before the begin of the sweep, and
    their unsigned offsets are 4.29 s."""
    tree = drive(TransformTree())
    points, offsets = sweep(rows=1)
    offsets = offsets - 3 * STEP
    expected = tree.deskew(points, BEGIN + offsets, "os_lidar", "odom", AT)
    sent = (offsets % (1 << 32)).astype(kind)
    assert sent.max() > 4.28 * S
    got = tree.deskew(points, sent, "os_lidar", "odom", AT, begin_ns=BEGIN)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)


def test_a_scan_from_0_on_has_no_lost_points() -> None:
    """ros-drivers/velodyne#402: offsets that begin at 0 are a sweep, not lost columns."""
    tree = drive(TransformTree())
    points, offsets = sweep(rows=1)
    ok = np.zeros(points.shape[:2], bool)
    tree.deskew(points, offsets, "os_lidar", "odom", AT, begin_ns=BEGIN, ok=ok)
    assert ok.all()


@pytest.mark.parametrize("entrance", ["tree", "query", "mapped", "mirror", "reparented"])
def test_rows_outside_of_the_history(shared_server: ServerProcess, entrance: str) -> None:
    """ouster-lidar/ouster-ros#350: whoever answers, what is too new or too old is NaN, the rest is
    there; a sweep without any time in the history is an error."""
    points, offsets = sweep(rows=2)
    stamps = BEGIN + offsets
    stamps[:7] -= 20 * S
    stamps[500] += 20 * S
    good = (stamps >= BEGIN) & (stamps <= AT)
    expected = drive(TransformTree()).deskew(points[:, good], stamps[good], "os_lidar", "odom", AT)

    def check(tf: Any) -> None:
        got = tf.deskew(points, stamps, "os_lidar", "odom", AT)
        np.testing.assert_allclose(got[:, good], expected, rtol=0, atol=1e-9)
        assert np.isnan(got[:, ~good]).all()
        with pytest.raises(ExtrapolationException):
            tf.deskew(points, stamps, "os_lidar", "odom", AT, strict=True)
        with pytest.raises(ForwardExtrapolationException):
            tf.deskew(points, stamps + 40 * S, "os_lidar", "odom", AT)
        with pytest.raises(ForwardExtrapolationException):
            tf.deskew(points, stamps, "os_lidar", "odom", AT + 40 * S)

    if entrance in ("tree", "reparented"):
        tree = drive(TransformTree())
        for i in range(2 * (entrance == "reparented")):
            tree.set_transform(StampedTransform(f"p{i}", "cup", BEGIN + i, Transform()))
        check(tree)
        return
    with shared_server.connect() as tf:
        tf.clear(keep_static=False)
        drive(tf)
    with shared_server.connect(10, "shared" if entrance == "mapped" else "query") as tf:
        if entrance != "mirror":
            check(tf)
            return
        with tf.mirror() as mirror:
            mirror.wait_for()
            check(mirror)


@pytest.mark.parametrize(("rate_hz", "gap_s"), [(50, 0.4), (200, 0.2), (10, 0.9)])
def test_points_in_a_gap_are_not_moved(rate_hz: int, gap_s: float) -> None:
    """ros2/geometry2#154: nothing was measured in a gap, so its points are NaN, unless the caller
    allows it."""
    tree = drive(drive(TransformTree(), -1, 0, rate_hz), gap_s, 1 + gap_s, rate_hz)
    stamps = np.linspace(BEGIN - S // 10, BEGIN + round((gap_s + 0.1) * S), 400).astype(np.int64)
    points = np.random.default_rng(5).normal(size=(400, 3))
    inside = (stamps > BEGIN) & (stamps < BEGIN + round(gap_s * S))
    at = int(stamps[-1])
    moved = tree.deskew(points, stamps, "os_lidar", "odom", at)
    assert np.array_equal(np.isnan(moved[:, 0]), inside)
    every = tree.deskew(points, stamps, "os_lidar", "odom", at, max_gap_s=gap_s)
    assert not np.isnan(every).any()
    np.testing.assert_allclose(every[~inside], moved[~inside], rtol=0, atol=1e-9)
    for options in ({"strict": True}, {"strict": True, "max_gap_s": gap_s / 2}):
        with pytest.raises(GapTooLong) as caught:
            tree.deskew(points, stamps, "os_lidar", "odom", at, **options)
        assert caught.value.gap_ns == round(gap_s * S)
    middle = BEGIN + round(gap_s / 2 * S)
    with pytest.raises(GapTooLong, match="much longer than usual"):
        tree.deskew(points, stamps, "os_lidar", "odom", middle)


@pytest.mark.parametrize(("rate_hz", "gap_s"), [(10, 9.0), (50, 0.6)])
def test_a_velocity_in_a_gap_says_so(rate_hz: int, gap_s: float) -> None:
    """ros2/geometry2#154: the velocity halfway was not measured; a limit refuses it."""
    tree = drive(drive(TransformTree(), -1, 0, rate_hz), gap_s, gap_s + 0.9, rate_hz)
    middle = BEGIN + round(gap_s / 2 * S)
    assert tree.lookup_velocity("os_lidar", "odom", middle).gap_ns == round(gap_s * S)
    assert tree.lookup_velocity("os_lidar", "odom", BEGIN + round(gap_s * S) + S // 2).gap_ns == 0
    with pytest.raises(GapTooLong) as caught:
        tree.lookup_velocity("os_lidar", "odom", middle, max_gap_s=0.25)
    assert caught.value.frame == "os_lidar"


@pytest.mark.parametrize(("rate_hz", "gap_s"), [(10, 9.0), (50, 3.0)])
def test_an_estimate_claims_nothing_in_a_gap(rate_hz: int, gap_s: float) -> None:
    """ros2/geometry2#154: in a gap, an estimate has no bound, or one that declared limits give."""
    tree = drive(drive(TransformTree(), -1, 0, rate_hz), gap_s, gap_s + 0.9, rate_hz)
    now = BEGIN + round((gap_s + 0.9) * S)
    middle = BEGIN + round(gap_s / 2 * S)
    tree._now_ns = lambda: now
    with pytest.raises(ExtrapolationException) as caught:
        tree.estimate_transform("odom", "os_lidar", middle, max_error_m=1)
    assert caught.value.frame == "os_lidar"
    found = tree.estimate_transform("odom", "os_lidar", middle)
    assert found.error_m == np.inf
    tree.set_motion_limits("os_lidar", max_speed_m_s=3, max_rate_rad_s=1)
    found = tree.estimate_transform("odom", "os_lidar", middle)
    assert gap_s <= found.error_m < 100
