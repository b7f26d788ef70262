"""`sample` and `lookup_transforms`: the same rows as single lookups."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.processes.servers import ServerProcess
from tests.support.runs import CONTROLS
from zenoh_tf import (
    InvalidArgumentException,
    StampedTransform,
    Transform,
    TransformArray,
    TransformException,
    TransformTree,
)
from zenoh_tf_client import TransformClient

S = 1_000_000_000
MS = 1_000_000


def fill(tf: TransformTree | TransformClient) -> None:
    """map -> base -> arm at 100 and 250 Hz from 0 to 2 s, a static camera on the arm; a box on
    the map, and from 1 s on in the arm."""
    random = np.random.default_rng(1)

    def links(parent: str, child: str, stamps: range) -> None:
        poses = random.normal(size=(len(stamps), 7))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        tf.set_transforms_xact(
            [
                StampedTransform(parent, child, stamp, Transform.from_pose(pose))
                for stamp, pose in zip(stamps, poses, strict=True)
            ]
        )

    links("map", "base", range(0, 2 * S + 1, 10 * MS))
    links("base", "arm", range(1 * MS, 2 * S, 4 * MS))
    links("map", "box", range(0, 1 * S, 20 * MS))
    links("arm", "box", range(1 * S, 2 * S, 20 * MS))
    tf.set_transform(StampedTransform("arm", "camera", 0, Transform((0, 0, 1))), static=True)


def one_by_one(
    tree: TransformTree, target: str, source: str, stamps: NDArray[np.int64]
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    status = np.zeros(len(stamps), np.uint8)
    poses = np.full((len(stamps), 7), np.nan)
    for row, stamp in enumerate(stamps.tolist()):
        try:
            poses[row] = tree.lookup_transform(target, source, stamp).transform.pose()
        except TransformException as error:
            status[row] = error.code
    return status, poses


def check(sampled: TransformArray, tree: TransformTree, *question: Any) -> None:
    status, poses = one_by_one(tree, *question)
    np.testing.assert_array_equal(sampled.status, status)
    np.testing.assert_allclose(
        sampled.poses, poses, rtol=0, atol=1e-12
    )  # the order of products differs; NaN equals NaN here
    found = sampled.ok
    np.testing.assert_array_equal(sampled.stamps_ns[found], question[2][found])


STAMPS: dict[str, NDArray[np.int64]] = {
    "sorted": np.linspace(-S // 10, 21 * S // 10, 1000).astype(np.int64),
    "dense": np.arange(995 * MS, 1005 * MS, 25_000, dtype=np.int64),
    "at samples": np.arange(0, 2 * S + 1, 10 * MS, dtype=np.int64),
    "unsorted": np.random.default_rng(2).integers(-S // 10, 21 * S // 10, 700),
    "backwards": np.arange(2 * S, -1, -3 * MS, dtype=np.int64),
    "one time": np.full(300, 1_234_567_891, np.int64),
    "few": np.arange(5, dtype=np.int64) * S // 4,
    "none": np.empty(0, np.int64),
    "too old": np.arange(-2 * S, -S, 7 * MS, dtype=np.int64),
    "ends of time": np.array([-(1 << 63) + 1, 0, (1 << 63) - 1] * 5),
}
PAIRS = [("map", "camera"), ("camera", "map"), ("box", "camera"), ("map", "box"), ("map", "map")]


@pytest.fixture(params=CONTROLS)
def tree(request: pytest.FixtureRequest) -> TransformTree:
    concurrency: Literal["optimistic", "2pl", "giant"] = request.param
    tree = TransformTree(concurrency=concurrency)
    fill(tree)
    return tree


@pytest.mark.parametrize("name", STAMPS)
def test_as_one_by_one(tree: TransformTree, name: str) -> None:
    for target, source in PAIRS:
        stamps = STAMPS[name]
        check(tree.sample(target, source, stamps), tree, target, source, stamps)


def test_pairs_change_from_row_to_row(tree: TransformTree) -> None:
    random = np.random.default_rng(3)
    rows = np.repeat(random.integers(0, len(PAIRS), 60), random.integers(1, 40, 60))
    targets = [PAIRS[row][0] for row in rows]
    sources = [PAIRS[row][1] for row in rows]
    stamps = random.integers(0, 2 * S, len(rows))
    many = tree.lookup_transforms(targets, sources, stamps)
    for row in range(0, len(rows), 7):
        where = slice(row, row + 1)
        status, poses = one_by_one(tree, targets[row], sources[row], stamps[where])
        np.testing.assert_array_equal(many.status[where], status)
        np.testing.assert_allclose(many.poses[where], poses, rtol=0, atol=1e-12)


@pytest.mark.parametrize("stamps", [[0.5], np.zeros((2, 3), np.int64), ["now"], [[1], [2, 3]]])
def test_invalid_stamps(tree: TransformTree, stamps: Any) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        tree.sample("map", "camera", stamps)
    assert caught.value.field == "stamps_ns"


def test_remote(any_server: ServerProcess) -> None:
    tree = TransformTree()
    fill(tree)
    with any_server.connect() as tf:
        fill(tf)
        for stamps in STAMPS.values():
            for target, source in PAIRS:
                check(tf.sample(target, source, stamps), tree, target, source, stamps)
        with tf.batch() as batch:
            handle = batch.sample("map", "camera", STAMPS["sorted"])
        check(handle.result(), tree, "map", "camera", STAMPS["sorted"])
