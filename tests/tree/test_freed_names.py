"""Frames that were removed give their places to new ones, embedded and behind a server."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from tests.conftest import LendServer
from tests.support.threads import beside
from zenoh_tf import (
    ConnectivityException,
    LimitExceeded,
    LookupException,
    StampedTransform,
    TransactionConflict,
    Transform,
    TransformTree,
)
from zenoh_tf_client import TransformClient

Tf = TransformTree | TransformClient
MakeTf = Callable[[int], Tf]


@pytest.fixture(params=["embedded", "remote"])
def make_tf(request: pytest.FixtureRequest, lend_server: LendServer) -> Iterator[MakeTf]:
    clients: list[TransformClient] = []

    def make(max_frames: int) -> Tf:
        if request.param == "embedded":
            return TransformTree(max_frames=max_frames)
        clients.append(lend_server("--limit", f"frames={max_frames}").connect())
        return clients[-1]

    yield make
    for client in clients:
        client.close()


def pose(parent: str, child: str, stamp_ns: int, x: float = 1.0) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform(translation=(x, 0.0, 0.0)))


def test_a_full_tree_has_room_after_a_removal(make_tf: MakeTf) -> None:
    tf = make_tf(4)
    for name in ("a", "b", "c"):
        tf.set_transform(pose("map", name, 1))
    for index in range(30):
        with pytest.raises(LimitExceeded):
            tf.set_transform(pose("map", "new", 1))
        tf.remove_frame("b" if index == 0 else f"b{index - 1}")
        tf.set_transform(pose("map", f"b{index}", 1, float(index)))
        assert tf.lookup_transform("map", f"b{index}").transform.translation[0] == index
    assert sorted(tf.frames()) == ["a", "b29", "c", "map"]
    with pytest.raises(LookupException):
        tf.lookup_transform("map", "b28")


def test_a_transaction_conflicts_if_its_frame_was_removed_and_came_back(
    lend_server: LendServer,
) -> None:
    with lend_server("--limit", "frames=4").connect() as tf:
        for others in range(4):
            tf.set_transform(pose("map", "cup", 1))
            with pytest.raises(TransactionConflict), tf.transaction() as xact:
                xact.lookup_latest_transform_xact("map", "cup")
                tf.remove_frame("cup")
                for index in range(others):  # they take its id
                    tf.set_transform(pose("map", f"other {index}", 1))
                    tf.remove_frame(f"other {index}")
                tf.set_transform(pose("map", "cup", 1))
                xact.set_transform(pose("map", "cup", 2))


def test_lookups_never_find_another_names_pose() -> None:
    """Every round has its own names and pose; readers ask for those that they saw last."""
    tree = TransformTree(max_frames=5)
    rounds = 3000
    now = 0
    found = [0, 0]

    def read(reader: int, ending: threading.Event) -> None:
        while not ending.is_set() or found[reader] == 0:
            index = now
            parent, child = f"parent {index}", f"child {index}"
            try:
                if reader == 0:
                    x = tree.lookup_transform(parent, child).transform.translation[0]
                else:
                    batch = tree.lookup_transforms([parent] * 20, [child] * 20, None)
                    x = float(batch.translations[0, 0])
                    if np.isnan(x):
                        continue
            except (LookupException, ConnectivityException):
                continue
            found[reader] += 1
            assert x == index, child

    tree.set_transform(pose("parent 0", "child 0", 1, 0.0))
    with beside(functools.partial(read, 0), functools.partial(read, 1)):
        for index in range(1, rounds):
            tree.set_transform(pose(f"parent {index}", f"child {index}", 1, float(index)))
            now = index
            tree.remove_frame(f"parent {index - 1}", subtree=True)
    assert min(found) > 0
