"""What becomes of a robot's frames at the site: puts of many frames, and a share of the tree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.conftest import StartServer
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, TransformException, TransformTree, wire
from zenoh_tf.errors import LimitExceeded
from zenoh_tf.wire.samples import SAMPLE, STATIC
from zenoh_tf_client import TransformClient
from zenoh_tf_server.federation import quota, rows
from zenoh_tf_server.ingest.put_queues import Put
from zenoh_tf_server.limits import Limits

Refused = list[tuple[str, int, TransformException]]


def rows_of(most: int = 1 << 20) -> tuple[rows.RobotRows, Refused]:
    refused: Refused = []

    def refuse(authority: str, count: int, error: TransformException) -> None:
        refused.append((authority, count, error))

    share = quota.FrameQuota("r", TransformTree(max_frames=100), most)
    return rows.RobotRows("r", ("map",), 100_000, share, refuse), refused


def frames(count: int, samples: int = 1, authorities: tuple[str, ...] = ("wheels",)) -> bytes:
    """A snapshot of frames below `map`, of authorities by turns; every fourth is static."""
    numbers: NDArray[np.uint32] = np.arange(1, count + 1, dtype=np.uint32)
    kept = np.where(numbers % 4 == 0, 1, samples).astype(np.uint32)
    total = int(kept.sum())
    stamp = np.concatenate([np.arange(1, each + 1, dtype=np.int64) for each in kept])
    pose = np.tile([0.0, 0, 0, 0, 0, 0, 1], (total, 1))
    return wire.pack(
        {
            "names": ["map", *(f"part{number}" for number in numbers)],
            "authorities": list(authorities),
            "frame": numbers.tobytes(),
            "version": np.ones(count, np.uint64).tobytes(),
            "static": (numbers % 4 == 0).astype(np.uint8).tobytes(),
            "authority": (numbers % len(authorities)).astype(np.uint32).tobytes(),
            "count": kept.tobytes(),
            "stamp": stamp.tobytes(),
            "parent": np.zeros(total, np.uint32).tobytes(),
            "pose": pose.tobytes(),
        }
    )


def children_of(put: Put) -> list[str]:
    return [put.payload.names[child] for child in put.payload.child]


def test_a_first_copy_has_many_frames_in_a_put() -> None:
    robot, refused = rows_of()
    puts = list(robot.of_frames(frames(10_000, authorities=("wheels", "arm"))))
    assert len(puts) <= 10_000 / 100 and not refused
    assert robot.received == 10_000
    stored = [(name, put.static) for put in puts for name in children_of(put)]
    assert sorted(stored) == sorted((f"r/part{n}", n % 4 == 0) for n in range(1, 10_001))
    assert {put.authority for put in puts} == {"r:wheels", "r:arm"}
    for put in puts:
        assert set(put.payload.parent.tolist()) == {put.payload.names.index("map")}
        assert len(put.payload.names) <= 129 and len(put.payload) <= 1024


def test_histories_are_whole_and_in_order() -> None:
    robot, _ = rows_of()
    tree = TransformTree()
    for put in robot.of_frames(frames(30, samples=700)):
        assert len(put.payload) <= 1024
        tree._commit_rows(put.payload, static=put.static)
    for number in range(1, 31):
        assert tree.frame(f"r/part{number}").samples == (1 if number % 4 == 0 else 700)


def test_a_first_copy_is_history_that_its_own_server_has_admitted() -> None:
    robot, _ = rows_of()
    [put] = robot.of_frames(frames(3, samples=5))
    assert put.is_history and put.is_relayed
    [put] = robot.of_changes(changes(("map", "part1", "wheels")))
    assert put.is_relayed and not put.is_history


def changes(*samples: tuple[str, str, str], static: bool = False, stamp: int = 1) -> bytes:
    """A message with samples: parent, child, authority."""
    names = sorted({name for sample in samples for name in sample[:2]})
    authorities = sorted({sample[2] for sample in samples})
    count = len(samples)
    kind = STATIC if static else SAMPLE
    columns: dict[str, NDArray[Any]] = {
        "kind": np.full(count, kind, np.uint8),
        "frame": np.array([names.index(child) for _, child, _ in samples], np.uint32),
        "version": np.ones(count, np.uint64),
        "parent": np.array([names.index(parent) for parent, _, _ in samples], np.uint32),
        "authority": np.array([authorities.index(each) for *_, each in samples], np.uint32),
        "stamp": np.arange(stamp, stamp + count, dtype=np.int64),
        "pose": np.tile([float(stamp), 0, 0, 0, 0, 0, 1], (count, 1)),
    }
    fields = {name: column.tobytes() for name, column in columns.items()}
    return wire.pack({"names": names, "authorities": authorities, **fields, "lost": b""})


def test_messages_alike_become_the_same_puts_as_the_first_of_them() -> None:
    robot, refused = rows_of(most=4)
    other, _ = rows_of(most=4)
    moves = ("map", "a", "wheels"), ("a", "b", "wheels"), ("earth", "map", "wheels")
    messages = [
        *(changes(*moves, stamp=stamp) for stamp in range(1, 5)),
        *(changes(*moves, static=True, stamp=stamp) for stamp in (5, 6)),
        *(changes(*moves[:2], stamp=stamp) for stamp in (7, 8)),
        *(changes(("map", "a", "wheels"), ("a", "b", "arm"), stamp=stamp) for stamp in (9, 10)),
        *(changes(("map", "a", "arm"), stamp=stamp) for stamp in (11, 12)),
        *(changes(("map", "a", "arm"), ("a", "e", "arm"), stamp=stamp) for stamp in (13, 14)),
        *(changes(("a", "f", "arm"), ("b", "g", "arm"), stamp=stamp) for stamp in (15, 16)),
        *(changes(*moves, stamp=stamp) for stamp in (17, 18)),
    ]
    known = 0
    for message in messages:
        known += robot._last is not None
        other._last = None
        for ours, theirs in zip(robot.of_changes(message), other.of_changes(message), strict=True):
            assert (ours.authority, ours.static, ours.size) == (
                theirs.authority,
                theirs.static,
                theirs.size,
            )
            assert ours.payload.names == theirs.payload.names
            assert ours.payload.columns() == theirs.payload.columns()
    assert known > 5  # otherwise this tests nothing
    counts = ("received", "left_out", "over_quota")
    assert [getattr(robot, name) for name in counts] == [getattr(other, name) for name in counts]
    assert robot.left_out > 0 and robot.over_quota > 0 and refused


def test_a_name_that_was_forgotten_counts_again() -> None:
    robot, _ = rows_of(most=1)
    message = changes(("map", "a", "wheels"))
    assert len(list(robot.of_changes(message))) == len(list(robot.of_changes(message))) == 1
    robot._quota._names.clear()
    robot._quota._new.clear()
    robot._quota.generation += 1
    assert len(list(robot.of_changes(changes(("map", "b", "wheels"))))) == 1
    assert not list(robot.of_changes(message)) and robot.over_quota == 1


def test_what_is_above_the_share_is_refused_and_counted() -> None:
    robot, refused = rows_of(most=10)
    puts = list(robot.of_frames(frames(30, authorities=("wheels", "arm"))))
    children = {name for put in puts for name in children_of(put)}
    assert len(children) == 10 and robot.over_quota == 20
    assert sum(count for _, count, _ in refused) == 20
    assert {authority for authority, _, _ in refused} == {"r:wheels", "r:arm"}
    error = refused[0][2]
    assert isinstance(error, LimitExceeded)
    assert (error.field, error.limit) == ("max-frames", 10)
    assert "robot 'r'" in str(error) and "--mirror-of" in str(error)
    # Frames that it has may still move.
    assert len(list(robot.of_frames(frames(10)))) > 0
    assert robot.over_quota == 20 + len({f"r/part{n}" for n in range(1, 11)} - children)


def test_frames_that_the_site_removes_can_be_others(monkeypatch: pytest.MonkeyPatch) -> None:
    tree = TransformTree()
    share = quota.FrameQuota("r", tree, 2)
    names = ["r/a", "r/b", "r/c", "map"]
    counted = np.array([True, True, True, False])

    def admit(child: int) -> bool:
        parent, column = np.array([3], np.uint32), np.array([child], np.uint32)
        return bool(share.admit(names, parent, column, counted)[0])

    assert admit(0) and admit(1) and not admit(2)
    for name in names[:2]:
        tree.set_transform(StampedTransform("map", name, 1, Transform()))
    monkeypatch.setattr(quota, "_REFRESH_S", 0.0)
    share._refresh_s = 0.0
    assert not admit(2)  # both are in the tree
    tree.remove_frame("r/a")
    assert admit(2) and not admit(0)
    assert len(share) == 2


def test_the_default_share_leaves_one_to_the_site() -> None:
    limits = Limits(frames=2000)
    assert quota.default_share(limits, 3) == 500
    assert quota.default_share(Limits(frames=2), 10) == 1


def has(tf: TransformClient, name: str) -> bool:
    return name in tf.frames()


def test_a_robot_with_too_many_frames_harms_nobody(start_server: StartServer) -> None:
    """A greedy robot with a share of its own, and a modest one with the default's."""
    greedy, modest = start_server(), start_server()
    for server, count in ((greedy, 60), (modest, 10)):
        with server.connect() as tf:
            tf.set_transforms_xact(
                [StampedTransform("map", f"part{n}", 1, Transform()) for n in range(count)]
            )
    site = start_server(
        *("--mirror-of", f"greedy={greedy.endpoint}/main,max-frames=20", "--limit", "frames=50"),
        *("--mirror-of", f"modest={modest.endpoint}", "--mirror-shared", "map"),
    )
    with site.connect() as tf:
        wait_until(
            lambda: tf.stats()["robot_over_quota/greedy"] == 40, "the greedy robot is refused"
        )
        wait_until(lambda: tf.stats()["robot_stored/modest"] == 10, "the modest robot's frames")
        wait_until(lambda: tf.stats()["robot_refused/greedy"] == 40, "its authorities know")
        stats = tf.stats()
        assert stats["robot_frames/greedy"] == stats["robot_max_frames/greedy"] == 20
        assert stats["robot_max_frames/modest"] == 16
        assert stats["robot_over_quota/modest"] == stats["robot_refused/modest"] == 0
        tf.set_transform(StampedTransform("map", "of the site", 1, Transform()))
        site.wait_for_log("robot 'greedy': LimitExceeded")
        # What it has still moves.
        with greedy.connect() as robot:
            moved = [
                StampedTransform("map", f"part{n}", 2, Transform((n, 0, 0))) for n in range(60)
            ]
            robot.set_transforms_xact(moved)
        wait_until(lambda: tf.stats()["robot_stored/greedy"] == 40, "samples of its frames")
        assert has(tf, "of the site") and len(tf.frames()) == 1 + 20 + 10 + 1
