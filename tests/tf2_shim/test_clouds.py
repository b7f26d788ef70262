"""Point clouds: every layout that a PointCloud2 may have, against numbers made by `struct`."""

from __future__ import annotations

import copy
import math
import struct
from array import array
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from zenoh_tf_client import tf2
from zenoh_tf_client.client import TransformClient

from .fake_ros.sensor_msgs.msg import PointCloud2, PointField
from .messages import link

FLOAT32, FLOAT64, UINT8 = 7, 8, 2
POINTS = [(1.0, 2.0, 0.0), (10.0, 20.0, 30.0)]
#: 180 degrees about x and 100 m up; and where it takes the points: row K09 of the suite.
TURNED = ((0.0, 0.0, 100.0), (1.0, 0.0, 0.0, 0.0))
EXPECTED = [(1.0, -2.0, 100.0), (10.0, -20.0, 70.0)]
TRANSFORM = link("map", "lidar", 2, *TURNED)

#: (struct format of a point, offsets of x, y, z): others come before, between and after.
LAYOUTS = {
    "plain": ("3f", (0, 4, 8)),
    "padded": ("3f4xHH", (0, 4, 8)),
    "spread": ("Bf2xfdf", (1, 7, 19)),  # unaligned
    "turned round": ("f3f", (12, 8, 4)),
}


def pack(order: str, layout: str, points: Any) -> tuple[list[bytes], tuple[int, int, int]]:
    form, offsets = LAYOUTS[layout]
    step = struct.calcsize("=" + form)
    packed = []
    for number, point in enumerate(points):
        raw = bytearray((number * 7 + byte) % 251 for byte in range(step))
        for offset, value in zip(offsets, point, strict=True):
            struct.pack_into(order + "f", raw, offset, value)
        packed.append(bytes(raw))
    return packed, offsets


def byte_array(data: bytes) -> array[int]:
    return array("B", data)


def cloud_of(
    points: Any,
    layout: str = "plain",
    order: str = "<",
    height: int = 1,
    gap: bytes = b"",
    kind: Any = byte_array,
) -> PointCloud2:
    packed, offsets = pack(order, layout, points)
    width = len(points) // height
    rows = [b"".join(packed[row * width : (row + 1) * width]) for row in range(height)]
    data = b"".join(row + gap for row in rows)
    step = len(packed[0]) if packed else 12
    fields = [PointField(n, o, FLOAT32, 1) for n, o in zip("xyz", offsets, strict=True)]
    fields.insert(1, PointField("ring", 0, UINT8, 1))
    cloud = PointCloud2(height=height, width=width, fields=fields, is_bigendian=order == ">")
    cloud.point_step, cloud.row_step, cloud.data = step, width * step + len(gap), kind(data)
    cloud.header.frame_id = "lidar"
    return cloud


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(("height", "gap"), [(1, b""), (2, b""), (2, b"gap")])
def test_layouts(layout: str, order: str, height: int, gap: bytes) -> None:
    """All other bytes stay as they are: the cloud is that of the moved points."""
    cloud = cloud_of(POINTS, layout, order, height, gap)
    before = copy.deepcopy(cloud)
    out = tf2.do_transform_cloud(cloud, TRANSFORM)
    assert out.data == cloud_of(EXPECTED, layout, order, height, gap).data
    assert (type(out), out.header.frame_id, out.header.stamp.sec) == (PointCloud2, "map", 2)
    assert cloud == before
    assert out.fields == cloud.fields
    out.fields[0].name = "mine"  # the copy shares nothing with the original
    assert cloud == before


@pytest.mark.parametrize(
    "kind",
    [bytes, bytearray, list, lambda data: array("B", data), lambda d: np.frombuffer(d, "u1")],
)
def test_the_data_keeps_its_type(kind: Any) -> None:
    cloud = cloud_of(POINTS, kind=kind)
    out = tf2.do_transform_cloud(cloud, TRANSFORM)
    assert type(out.data) is type(cloud.data)
    assert bytes(out.data) == bytes(cloud_of(EXPECTED).data)


def test_invalid_points_stay_in_their_places() -> None:
    points = [(math.nan, math.nan, math.nan), (1.0, 2.0, 0.0), (math.inf, 0.0, 0.0)]
    data = tf2.do_transform_cloud(cloud_of(points, height=3), TRANSFORM).data
    got = np.frombuffer(data, np.float32).reshape(3, 3)
    assert np.isnan(got[0]).all()
    assert got[1].tolist() == [1.0, -2.0, 100.0]
    assert not np.isfinite(got[2, 0])


@pytest.mark.parametrize(
    ("step", "offsets"),
    [(12, (0, 4, 8)), (16, (0, 4, 8)), (22, (0, 4, 8)), (32, (0, 4, 8)), (48, (16, 20, 24))],
    ids=["xyz", "xyzi", "22 bytes, unaligned", "xyzrgb", "48 bytes"],
)
@pytest.mark.parametrize(("height", "width"), [(1, 15), (5, 3), (3, 5), (15, 1)])
@pytest.mark.parametrize("padding", [0, 10])
def test_organised_clouds_of_any_point_step(
    step: int, offsets: tuple[int, int, int], height: int, width: int, padding: int
) -> None:
    """As drivers lay out their points, in rows with bytes behind them: each point is moved as if
    it were alone, and no other byte changes."""
    random = np.random.default_rng(step)
    rows = random.integers(0, 256, (height, width * step + padding), np.uint8)
    points = rows[:, : width * step].reshape(height, width, step)
    numbers = random.normal(size=(height, width, 3)).astype("<f4")
    for axis, offset in enumerate(offsets):
        points[..., offset : offset + 4] = numbers[..., axis : axis + 1].view(np.uint8)
    rows[:, : width * step] = points.reshape(height, -1)
    fields = [PointField(n, o, FLOAT32, 1) for n, o in zip("xyz", offsets, strict=True)]
    cloud = PointCloud2(height=height, width=width, fields=fields, is_bigendian=False)
    cloud.point_step, cloud.row_step, cloud.data = step, rows.shape[1], rows.tobytes()
    data = tf2.do_transform_cloud(cloud, TRANSFORM).data

    expected = points.copy()
    moved = (numbers * [1, -1, -1] + [0, 0, 100]).astype("<f4")
    for axis, offset in enumerate(offsets):
        expected[..., offset : offset + 4] = moved[..., axis : axis + 1].copy().view(np.uint8)
    got = np.frombuffer(data, np.uint8).reshape(rows.shape)
    np.testing.assert_array_equal(got[:, width * step :], rows[:, width * step :])
    np.testing.assert_array_equal(got[:, : width * step].reshape(points.shape), expected)


def test_no_points() -> None:
    out = tf2.do_transform_cloud(cloud_of([]), TRANSFORM)
    assert (len(out.data), out.header.frame_id) == (0, "map")


# The last is of a damaged message: a step for each of its rows would take an hour.
@pytest.mark.parametrize(("height", "width"), [(0, 2), (2, 0), (0, 0), (2**40, 0)])
def test_no_points_but_bytes(height: int, width: int) -> None:
    cloud = cloud_of(POINTS)
    cloud.height, cloud.width, cloud.data = height, width, cloud.data[:5]
    assert tf2.do_transform_cloud(cloud, TRANSFORM).data == cloud.data


def test_what_exceeds_32_bits_is_infinite() -> None:
    far = link("map", "lidar", 2, (1e300, 0.0, 0.0))
    data = tf2.do_transform_cloud(cloud_of([(0.0, 0.0, 1.0)]), far).data
    assert np.frombuffer(data, np.float32).tolist() == [math.inf, 0.0, 1.0]


def damaged(change: Any) -> PointCloud2:
    cloud = cloud_of(POINTS)
    change(cloud)
    return cloud


def vars_of(message: Any, **values: Any) -> None:
    for name, value in values.items():
        setattr(message, name, value)


REFUSED: dict[str, tuple[Any, str]] = {
    "doubles": (lambda cloud: vars_of(cloud.fields[2], datatype=FLOAT64), "y"),
    "two of them": (lambda cloud: vars_of(cloud.fields[3], count=2), "z"),
    "no x": (lambda cloud: cloud.fields.pop(0), "x"),
    "outside of the point": (lambda cloud: vars_of(cloud.fields[3], offset=9), "z"),
    "before the point": (lambda cloud: vars_of(cloud.fields[3], offset=-1), "z"),
    "huge": (lambda cloud: vars_of(cloud, width=2**31, height=2**31), "data"),
    "points without size": (
        lambda cloud: vars_of(cloud, width=2**31, height=2**31, point_step=0, row_step=0),
        "x",
    ),
    "too short": (lambda cloud: cloud.data.pop(), "data"),
    "negative": (lambda cloud: vars_of(cloud, height=-1), "data"),
    "no data": (lambda cloud: vars_of(cloud, data=array("B")), "data"),
    "wider than a row": (lambda cloud: vars_of(cloud, height=2), "data"),
    "rows that overlap": (
        lambda cloud: vars_of(cloud, height=2, row_step=0),
        "data",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_name_the_field(name: str) -> None:
    change, field = REFUSED[name]
    with pytest.raises(tf2.InvalidArgumentException) as refusal:
        tf2.do_transform_cloud(damaged(change), TRANSFORM)
    assert refusal.value.field == field
    assert field in str(refusal.value)


def test_through_the_buffer(shim: TransformClient) -> None:
    buffer = tf2.Buffer()
    buffer.set_transform(TRANSFORM, "")
    cloud = cloud_of(POINTS)
    cloud.header.stamp = TRANSFORM.header.stamp
    assert buffer.transform(cloud, "map").data == cloud_of(EXPECTED).data


def test_real_messages() -> None:
    """Of rosbags, whose classes come from ROS 2's definitions: the data is an array of NumPy's."""
    types: Any = get_typestore(Stores.ROS2_JAZZY).types
    ours = cloud_of(POINTS, "padded")
    real_field = types["sensor_msgs/msg/PointField"]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 2), "lidar")
    cloud = types["sensor_msgs/msg/PointCloud2"](
        header=header,
        height=1,
        width=2,
        fields=[real_field(f.name, f.offset, f.datatype, f.count) for f in ours.fields],
        is_bigendian=False,
        point_step=ours.point_step,
        row_step=ours.row_step,
        data=np.frombuffer(ours.data, np.uint8),
        is_dense=True,
    )
    out = tf2.do_transform_cloud(cloud, TRANSFORM)
    assert type(out) is type(cloud)
    assert out.data.tobytes() == bytes(cloud_of(EXPECTED, "padded").data)
    assert (out.header.frame_id, out.header.stamp.sec) == ("map", 2)
    assert cloud.header.frame_id == "lidar"
