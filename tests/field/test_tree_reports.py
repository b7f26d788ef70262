"""Public reports about trees, velocities, sweeps and clouds, replayed on a tree of this process."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from zenoh_tf import InvalidArgumentException, StampedTransform, Transform, TransformTree
from zenoh_tf_client import tf2

S = 10**9
Vector = tuple[float, float, float]


def stamped(
    parent: str,
    child: str,
    stamp_s: float,
    xyz: Vector = (0, 0, 0),
    rotation: tuple[float, float, float, float] = (0, 0, 0, 1),
) -> StampedTransform:
    return StampedTransform(parent, child, round(stamp_s * S), Transform(xyz, rotation))


def turned(axis: Vector, angle_rad: float, sign: float = 1.0) -> Any:
    half = angle_rad / 2
    x, y, z = (math.sin(half) * part for part in axis)
    return tuple(sign * part for part in (x, y, z, math.cos(half)))


@pytest.mark.parametrize(
    ("axis", "rate", "every"), [((0, 0, 1), 1.0, 2), ((0.6, 0, 0.8), -2.5, 7), ((0, 1, 0), 6.0, 3)]
)
def test_signs_of_quaternions_may_flip(axis: Vector, rate: float, every: int) -> None:
    """gazebosim/gz-sim#3834: q and -q are the same rotation, so an even turn stays even."""
    tree = TransformTree()
    for step in range(200):
        sign = -1.0 if step % every else 1.0
        q = turned(axis, rate * step / 100, sign)
        tree.set_transform(stamped("odom", "base", 1 + step / 100, (0, 0, 0), q))
    for stamp_s in (1.205, 1.9, 2.773):
        velocity = tree.lookup_velocity("base", "odom", round(stamp_s * S), 0.03)
        np.testing.assert_allclose(velocity.angular, np.multiply(axis, rate), atol=1e-6)
        found = tree.lookup_transform("odom", "base", round(stamp_s * S)).transform
        assert abs(found.rotation @ turned(axis, rate * (stamp_s - 1))) == pytest.approx(
            1, abs=1e-9
        )


@pytest.mark.parametrize(("frame", "sign"), [("base", 1), ("ee", 1), ("map", -1)])
def test_a_twist_is_in_the_axes_of_the_reference_frame(frame: str, sign: int) -> None:
    """ros/geometry#43: the axes are those of the reference frame, at the point of the reference."""
    tree = TransformTree()
    tree.set_transform(stamped("map", "base", 0, rotation=turned((0, 0, 1), math.pi)), static=True)
    for step in range(20):
        ahead = (0.1 * step, 0.0, 0.0)
        tree.set_transform(
            stamped("base", "ee", 1 + step / 10, ahead, turned((1, 0, 0), step / 10))
        )
    velocity = tree.lookup_velocity("ee", "base", 2 * S, 0.2, reference_frame=frame)
    np.testing.assert_allclose(velocity.linear, (sign, 0, 0), atol=1e-9)
    np.testing.assert_allclose(velocity.angular, (sign, 0, 0), atol=1e-9)


@pytest.mark.parametrize(("first", "second"), [("odom", "base"), ("local_origin", "fcu")])
def test_a_link_published_in_both_directions(first: str, second: str) -> None:
    """mavlink/mavros#1278 (ros/geometry2#388): the second direction is refused by name, and the
    history of the first stays, so an old stamp has the old pose."""
    tree = TransformTree()
    for step in range(10):
        tree.set_transform(stamped(first, second, 1 + step / 10, (step, 0, 0)), authority="pose")
        with pytest.raises(InvalidArgumentException, match=f"'{first}'.*'{second}'.*cycle"):
            tree.set_transform(stamped(second, first, 1 + step / 10, (-step, 0, 0)))
    for step in (0, 4, 9):
        found = tree.lookup_transform(first, second, S + step * S // 10)
        assert found.transform.translation[0] == pytest.approx(step)


@pytest.mark.parametrize(
    "rounded",
    [
        (0.02, -0.028, -0.004, 0.999),
        (-0.074733, 0.036896, 0.843233, 0.531062),
        (-0.018815, 0.013563, -1.000259, 0.046847),
        (-0.5, 0.5, -0.5, 0.4999),
    ],
)
def test_quaternions_of_a_few_digits(rounded: tuple[float, float, float, float]) -> None:
    """introlab/rtabmap_ros#153, CCNYRoboticsLab/imu_tools#67, Nishida-Lab/motoman_project#92:
    what is a rotation but for its last digits is stored with length 1."""
    tree = TransformTree()
    tree.set_transform(stamped("base", "camera", 1, (0, 0, 1), rounded))
    found = tree.lookup_transform("base", "camera", S).transform.rotation
    np.testing.assert_allclose(found, np.array(rounded) / np.linalg.norm(rounded), atol=1e-12)


@pytest.mark.parametrize("again", [1, 3])
def test_an_estimate_is_corrected_at_the_same_stamp(again: int) -> None:
    """cra-ros-pkg/robot_localization#574, DFKI-NI/mir_robot#88: a late measurement gives a better
    estimate of the same instant; readers get the better one, and the repetition is counted."""
    tree = TransformTree()
    for step in range(5):
        for attempt in range(again + 1):
            pose = (step + attempt / 8, 0, 0)
            tree.set_transform(stamped("odom", "base", 1 + step, pose), authority="ekf")
    base = tree.frame("base")
    assert (base.samples, base.rewritten) == (5, 5 * again)
    found = tree.lookup_transform("odom", "base", 3 * S + S // 2)
    assert found.transform.translation[0] == pytest.approx(2.5 + again / 8)


@pytest.mark.parametrize(
    "origin", [(388_096.0, 3_948_996.0, 40.0), (-2_347_343.0, 5_394_975.0, 2_454_461.0)]
)
def test_a_sweep_far_from_the_origin_keeps_its_millimetres(origin: Vector) -> None:
    """PointCloudLibrary/pcl#2176, autowarefoundation/autoware_universe#3090: UTM and ECEF have
    steps of half a metre in 32 bits, so only the motion may be in the result."""
    tree = TransformTree()
    for step in range(11):
        x, y, z = origin
        tree.set_transform(stamped("utm", "lidar", 1 + step / 10, (x + step, y, z)))
    points = np.random.default_rng(3).uniform(-40, 40, (500, 3)).astype(np.float32)
    share = np.linspace(0, 1, 500)
    stamps_ns = S + (share * S).astype(np.int64)
    moved = tree.deskew(points, stamps_ns, "lidar", "utm", S)
    expected = points.astype(np.float64) + np.outer(share * 10, (1, 0, 0))
    np.testing.assert_allclose(moved, expected, atol=1e-4)
    # In UTM itself, 64 bits hold them.
    at = tree.lookup_transform("utm", "lidar", S).transform
    wide = at.apply(points, out=np.empty(points.shape))
    np.testing.assert_allclose(wide - np.array(origin), points, atol=1e-6)


def cloud(step: int, row_padding: int, big_endian: bool) -> Any:
    """An organised cloud of 3 rows and 4 columns, whose point (1, 2) is NaN."""
    order = ">" if big_endian else "<"
    fields = {"x": 0, "y": 4, "z": 8, "intensity": 16}
    kind = np.dtype(
        {
            "names": [*fields],
            "formats": [f"{order}f4"] * 4,
            "offsets": [*fields.values()],
            "itemsize": step,
        }
    )
    rows = [np.zeros(4, kind) for _ in range(3)]
    for number, row in enumerate(rows):
        row["x"], row["y"], row["z"] = np.arange(4), number, 0.5
        row["intensity"] = 10 * number + np.arange(4)
    rows[1]["x"][2] = rows[1]["y"][2] = rows[1]["z"][2] = np.nan
    return SimpleNamespace(
        header=tf2.Header(tf2.Time(1), "lidar"),
        height=3,
        width=4,
        fields=[
            SimpleNamespace(name=name, offset=offset, datatype=7, count=1)
            for name, offset in fields.items()
        ],
        is_bigendian=big_endian,
        point_step=step,
        row_step=4 * step + row_padding,
        data=b"".join(row.tobytes() + b"\x7f" * row_padding for row in rows),
        is_dense=False,
    )


@pytest.mark.parametrize(
    ("step", "row_padding", "big_endian"), [(20, 0, False), (32, 16, False), (48, 0, True)]
)
def test_clouds_with_padding_keep_their_shape_and_fields(
    step: int, row_padding: int, big_endian: bool
) -> None:
    """ifm/o3d3xx-ros#19, ros2/common_interfaces#223, ros/geometry2#241, PointCloudLibrary/pcl#4488:
    bytes behind a point or a row belong to the message, and an invalid point stays where it is."""
    message = cloud(step, row_padding, big_endian)
    transform = tf2.TransformStamped(tf2.Header(tf2.Time(2), "base"), "lidar")
    transform.transform.translation.y = 100.0
    out = tf2.do_transform_cloud(message, transform)
    assert (out.height, out.width, out.header.frame_id) == (3, 4, "base")
    assert len(out.data) == len(message.data)
    number = np.dtype(">f4" if big_endian else "<f4")
    for row in range(3):
        for column in range(4):
            at = row * message.row_step + column * step
            x, y, z = np.frombuffer(out.data, number, 3, at)
            assert out.data[at + 12 : at + step] == message.data[at + 12 : at + step]
            if (row, column) == (1, 2):
                assert np.isnan([x, y, z]).all()
            else:
                assert (x, y, z) == (column, row + 100, 0.5)
        assert out.data[at + step : at + step + row_padding] == b"\x7f" * row_padding


@pytest.mark.parametrize("step", [20, 36, 48])
def test_a_sweep_is_read_where_it_lies_in_the_message(step: int) -> None:
    """ros2/common_interfaces#223: records of 48 bytes with 36 of fields, also of odd sizes."""
    tree = TransformTree()
    for second in (1, 2):
        tree.set_transform(stamped("odom", "lidar", second, (second, 0, 0)))
    kind = np.dtype(
        {
            "names": ["x", "y", "z", "t"],
            "formats": ["<f4", "<f4", "<f4", "<u4"],
            "offsets": [0, 4, 8, 16],
            "itemsize": step,
        }
    )
    records = np.zeros(6, kind)
    records["x"], records["t"] = np.arange(6), np.arange(6) * S // 5
    points = np.ndarray((6, 3), "<f4", records.data, strides=(step, 4))
    moved = tree.deskew(points, S + records["t"].astype(np.int64), "lidar", "odom", S)
    np.testing.assert_allclose(moved[:, 0], np.arange(6) + np.arange(6) / 5, atol=1e-6)
