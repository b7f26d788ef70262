"""deskew: a sweep's points, as if all had been measured at one time."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.support.threads import beside
from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    StampedTransform,
    Transform,
    TransformTree,
)
from zenoh_tf_client import TransformClient

pytestmark = pytest.mark.filterwarnings("error")

MS = 1_000_000
START = 10**18
AT = START + 1_100 * MS
RNG = np.random.default_rng(7)


def turned(angle: float, axis: tuple[float, float, float] = (0, 0, 1)) -> tuple[float, ...]:
    unit = np.asarray(axis) / np.linalg.norm(axis)
    return (*(math.sin(angle / 2) * unit), math.cos(angle / 2))


def drive() -> list[StampedTransform]:
    """A robot that turns and jolts, at 100 Hz, on a map that is corrected at 15 Hz."""
    rows = []
    for i in range(200):
        pose = Transform((0.02 * i, math.sin(i / 9), 0.1), turned(0.03 * i, (0.1, 0.05, 1)))
        rows.append(StampedTransform("odom", "base", START + 10 * i * MS, pose))
    for i in range(30):
        pose = Transform((0.1 * math.sin(i), 0.1, 0), turned(0.2 * i))
        rows.append(StampedTransform("map", "odom", START + 66 * i * MS, pose))
    return rows


MOUNT = StampedTransform("base", "lidar", 0, Transform((0.1, 0.2, 1), turned(1, (1, 2, 3))))


def fill(tree: Any) -> Any:
    tree.set_transforms_xact(drive())
    tree.set_transform(MOUNT, static=True)
    return tree


@pytest.fixture(scope="module")
def tree() -> TransformTree:
    filled: TransformTree = fill(TransformTree())
    return filled


def sweep(n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    stamps = np.linspace(START + 1_000 * MS, AT, n).astype(np.int64)
    return RNG.normal(size=(n, 3)) * 30, stamps


def by_lookups(
    tree: Any, points: NDArray[Any], stamps: NDArray[np.int64], fixed: str, at: int = AT
) -> NDArray[np.float64]:
    """A lookup for each point."""
    return np.array(
        [
            tree.lookup_transform_full("lidar", at, "lidar", int(stamp), fixed).transform.apply(p)
            for p, stamp in zip(points, stamps, strict=True)
        ]
    )


@pytest.mark.parametrize("fixed", ["base", "odom", "map", "lidar"])
@pytest.mark.parametrize("at", [AT, START + 1_050 * MS, START + 500 * MS])
def test_it_is_a_lookup_for_each_point(tree: TransformTree, fixed: str, at: int) -> None:
    points, stamps = sweep(500)
    expected = by_lookups(tree, points, stamps, fixed, at)
    got = tree.deskew(points, stamps, "lidar", fixed, at)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    order = RNG.permutation(len(points))  # stamps in any order
    shuffled = tree.deskew(points[order], stamps[order], "lidar", fixed, at)
    np.testing.assert_allclose(shuffled, expected[order], rtol=0, atol=1e-9)


def test_a_wall_is_straight_again(tree: TransformTree) -> None:
    """Points of a wall, each measured from where the lidar was at its time."""
    wall = np.column_stack([np.linspace(-5, 5, 300), np.full(300, 8.0), np.linspace(0, 2, 300)])
    _, stamps = sweep(300)
    poses = tree.sample("odom", "lidar", stamps).raise_for_status()
    measured = poses.inverse().apply(wall)
    upright = tree.lookup_transform("odom", "lidar", AT).transform
    smeared = upright.apply(measured)
    straight = upright.apply(tree.deskew(measured, stamps, "lidar", "odom", AT))
    np.testing.assert_allclose(straight, wall, rtol=0, atol=1e-9)
    assert np.abs(smeared - wall).max() > 1


def test_types_shapes_and_strides(tree: TransformTree) -> None:
    points, stamps = sweep(512)
    expected = tree.deskew(points, stamps, "lidar", "map", AT)
    assert expected.dtype == np.float64
    assert expected.shape == (512, 3)
    single = tree.deskew(points.astype(np.float32), stamps, "lidar", "map", AT)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, rtol=0, atol=2e-5)

    records = np.zeros(512, [("xyz", np.float32, 3), ("ring", np.uint16), ("t", np.uint32)])
    assert records["xyz"].strides[0] % 4 != 0  # as clouds arrive: no array of floats
    records["xyz"] = points
    np.testing.assert_array_equal(tree.deskew(records["xyz"], stamps, "lidar", "map", AT), single)
    tree.deskew(records["xyz"], stamps, "lidar", "map", AT, out=records["xyz"])
    np.testing.assert_array_equal(records["xyz"], single)
    padded = np.zeros((512, 5))
    padded[:, 1:4] = points
    np.testing.assert_array_equal(tree.deskew(padded[:, 1:4], stamps, "lidar", "map", AT), expected)
    np.testing.assert_array_equal(
        tree.deskew(points[::-1], stamps[::-1], "lidar", "map", AT)[::-1], expected
    )
    big_endian = points.astype(">f8")
    np.testing.assert_array_equal(tree.deskew(big_endian, stamps, "lidar", "map", AT), expected)
    whole = np.round(points).astype(int)
    np.testing.assert_array_equal(
        tree.deskew(whole, stamps, "lidar", "map", AT),
        tree.deskew(whole.astype(float), stamps, "lidar", "map", AT),
    )

    grid, columns = points.reshape(8, 64, 3), stamps[::8].copy()  # a stamp for each column
    by_column = tree.deskew(grid, columns, "lidar", "map", AT)
    assert by_column.shape == (8, 64, 3)
    flat = tree.deskew(points, np.tile(columns, 8), "lidar", "map", AT)
    np.testing.assert_array_equal(by_column.reshape(-1, 3), flat)
    one = tree.deskew(points[3], stamps[3], "lidar", "map", AT)
    np.testing.assert_allclose(one, expected[3], rtol=0, atol=1e-12)
    assert tree.deskew(points[:0], stamps[:0], "lidar", "map", AT).shape == (0, 3)


def test_the_result_goes_to_out(tree: TransformTree) -> None:
    points, stamps = sweep(300)
    before = points.copy()
    expected = tree.deskew(points, stamps, "lidar", "map", AT)
    np.testing.assert_array_equal(points, before)
    for kind in (np.float64, np.float32):
        out = np.zeros((300, 4), kind)
        assert tree.deskew(points, stamps, "lidar", "map", AT, out=out[:, :3]).base is out
        np.testing.assert_allclose(out[:, :3], expected, rtol=0, atol=2e-5)
        assert not out[:, 3].any()
    assert tree.deskew(points, stamps, "lidar", "map", AT, out=points) is points
    np.testing.assert_array_equal(points, expected)


def test_points_that_were_not_measured_stay_nan(tree: TransformTree) -> None:
    points, stamps = sweep(100)
    points[::3] = np.nan
    got = tree.deskew(points, stamps, "lidar", "map", AT)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(points))


def test_errors_name_the_frame_and_the_stamp(tree: TransformTree) -> None:
    points, stamps = sweep(10)
    late, early = START + 5_000 * MS, START - 1
    with pytest.raises(ForwardExtrapolationException) as forward:
        tree.deskew(points, np.where(stamps == AT, late, stamps), *FRAMES, strict=True)
    with pytest.raises(ForwardExtrapolationException) as looked_up:
        tree.lookup_transform("odom", "lidar", late)
    assert str(forward.value) == str(looked_up.value)
    assert (forward.value.stamp_ns, forward.value.frame) == (late, looked_up.value.frame)
    with pytest.raises(BackwardExtrapolationException, match=str(early)):
        tree.deskew(points, np.where(stamps == AT, early, stamps), *FRAMES, strict=True)
    with pytest.raises(ForwardExtrapolationException, match=str(late)):
        tree.deskew(points, stamps, "lidar", "odom", late)
    with pytest.raises(LookupException, match="'lidr'"):
        tree.deskew(points, stamps, "lidr", "odom", AT)
    with pytest.raises(LookupException, match="'world'"):
        tree.deskew(points, stamps, "lidar", "world", AT)
    apart = fill(TransformTree())
    apart.set_transform(StampedTransform("sea", "buoy", AT, Transform()))
    with pytest.raises(ConnectivityException, match="'sea'"):
        apart.deskew(points, stamps, "lidar", "sea", AT)


#: Source, fixed frame and time.
FRAMES = ("lidar", "odom", AT)

BAD: list[tuple[str, dict[str, Any]]] = [
    ("points", {"points": np.zeros((4, 2))}),
    ("points", {"points": np.zeros((2, 2, 1, 3))}),
    ("points", {"points": [["a", "b", "c"]] * 4}),
    ("points", {"points": None}),
    ("points", {"points": np.zeros((4, 3), complex)}),
    ("stamps_ns", {"stamps_ns": np.zeros(3, np.int64)}),
    ("stamps_ns", {"stamps_ns": np.zeros(4)}),
    ("stamps_ns", {"stamps_ns": None}),
    ("stamps_ns", {"stamps_ns": np.full(4, 1 << 63, np.uint64)}),
    ("stamps_ns", {"stamps_ns": np.full(4, -(1 << 63))}),
    ("at_ns", {"at_ns": None}),
    ("at_ns", {"at_ns": 1.5}),
    ("at_ns", {"at_ns": 1 << 63}),
    ("source_frame", {"source": ""}),
    ("fixed_frame", {"fixed_frame": "/map"}),
    ("fixed_frame", {"fixed_frame": 7}),
    ("out", {"out": np.zeros((3, 3))}),
    ("out", {"out": np.zeros((4, 3), int)}),
    ("out", {"out": np.broadcast_to(0.0, (4, 3))}),
    ("out", {"out": [[0.0] * 3] * 4}),
    ("ok", {"ok": np.zeros(3, bool)}),
    ("ok", {"ok": np.zeros(4)}),
    ("missing", {"missing": "zero"}),
    ("begin_ns", {"begin_ns": 1.5}),
    ("max_gap_s", {"max_gap_s": -0.1}),
]


@pytest.mark.parametrize(("field", "change"), BAD)
def test_bad_arguments(tree: TransformTree, field: str, change: dict[str, Any]) -> None:
    good: dict[str, Any] = {
        "points": np.zeros((4, 3)),
        "stamps_ns": np.full(4, AT),
        "source": "lidar",
        "fixed_frame": "map",
        "at_ns": AT,
    }
    tree.deskew(**good)
    with pytest.raises(InvalidArgumentException) as raised:
        tree.deskew(**good | change)
    assert raised.value.field == field


def test_where_frames_were_reparented(tree: TransformTree) -> None:
    """Then a path may differ from time to time, and each time is looked up by itself."""
    other = fill(TransformTree())
    for i in range(3):
        parent = "base" if i else "map"
        other.set_transform(StampedTransform(parent, "cup", START + 500 * i * MS, Transform()))
    points, stamps = sweep(400)
    for fixed in ("odom", "map"):
        np.testing.assert_array_equal(
            other.deskew(points, stamps, "lidar", fixed, AT),
            tree.deskew(points, stamps, "lidar", fixed, AT),
        )
    stamps = np.linspace(START + 100 * MS, START + 900 * MS, 400).astype(np.int64)
    at = START + 700 * MS
    expected = np.array(
        [
            other.lookup_transform_full("cup", at, "cup", int(stamp), "map").transform.apply(p)
            for p, stamp in zip(points, stamps, strict=True)
        ]
    )
    got = other.deskew(points, stamps, "cup", "map", at)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    with pytest.raises(ForwardExtrapolationException):
        other.deskew(points, stamps, "cup", "map", START + 1_500 * MS)


def test_all_poses_are_of_one_state() -> None:
    """A writer shifts the whole history again and again: no sweep mixes two of its commits."""
    tree = TransformTree()

    def shift(x: float) -> None:
        rows = [
            StampedTransform("map", "lidar", i * 10 * MS, Transform((x, 0, 0))) for i in range(50)
        ]
        tree.set_transforms_xact(rows)

    shift(0)

    def write(ending: threading.Event) -> None:
        x = 0
        while not ending.is_set():
            shift(x := x + 1)

    with beside(write):
        points = np.zeros((5_000, 3))
        stamps = np.linspace(0, 490 * MS, 5_000).astype(np.int64)
        for _ in range(200):
            assert not tree.deskew(points, stamps, "lidar", "map", 100 * MS).any()


# --- on a connection


@pytest.fixture
def shared(server: ServerProcess) -> Iterator[TransformClient]:
    with server.connect(reads="shared") as client:
        assert client.reads == "shared"
        yield client


def check_client(client: Any, tree: TransformTree, atol: float) -> None:
    fill(client)
    points, stamps = sweep(300)
    stamps = np.repeat(stamps[::3], 3)
    expected = tree.deskew(points, stamps, "lidar", "map", AT)
    got = client.deskew(points, stamps, "lidar", "map", AT)
    np.testing.assert_allclose(got, expected, rtol=0, atol=atol)
    out = np.zeros((300, 3), np.float32)
    assert client.deskew(points, stamps, "lidar", "map", AT, out=out) is out
    np.testing.assert_allclose(out, expected, rtol=0, atol=2e-5)
    with pytest.raises(ForwardExtrapolationException) as forward:
        client.deskew(points, stamps, "lidar", "odom", AT + 5_000 * MS)
    assert forward.value.stamp_ns == AT + 5_000 * MS
    with pytest.raises(LookupException, match="'lidr'"):
        client.deskew(points, stamps, "lidr", "odom", AT)
    with pytest.raises(InvalidArgumentException):
        client.deskew(points, stamps[1:], "lidar", "odom", AT)


def test_by_query(
    server: ServerProcess, tree: TransformTree, either_client: Callable[..., Any]
) -> None:
    with server.connect() as client:
        check_client(client, tree, 1e-9)


def test_from_shared_memory_and_a_mirror(shared: TransformClient, tree: TransformTree) -> None:
    check_client(shared, tree, 0)
    points, stamps = sweep(1_000)
    expected = tree.deskew(points, stamps, "lidar", "map", AT)
    asked = {name: n for name, n in shared.stats().items() if name.startswith("reads_asked")}
    with shared.mirror() as mirror:
        np.testing.assert_array_equal(mirror.deskew(points, stamps, "lidar", "map", AT), expected)
    np.testing.assert_array_equal(shared.deskew(points, stamps, "lidar", "map", AT), expected)
    now = shared.stats()
    assert {name: now[name] for name in asked} == asked  # nothing of it was a query


def test_more_stamps_than_a_message_may_have(start_server: StartServer) -> None:
    with start_server("--limit", "rows=500").connect() as client:
        for rows in np.array_split(np.array(drive(), object), 10):
            client.set_transforms_xact(list(rows))
        client.set_transform(MOUNT, static=True)
        points, stamps = sweep(600)
        client.deskew(points, stamps // MS * MS, "lidar", "odom", AT)
        with pytest.raises(LimitExceeded, match="rows"):
            client.deskew(points, stamps, "lidar", "odom", AT)
