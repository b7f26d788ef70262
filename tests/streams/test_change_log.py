"""The change log, snapshots, and their replay: a mirror is exactly the tree."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgpack
import numpy as np
import pytest

from tests.support.logged_trees import FEW_FRAMES, Mirror, Writer, logged, make_tree, state
from tests.support.runs import CONTROLS
from tests.support.threads import beside
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf._core import ChangeLog, ChangeReplay, Changes, TransformRows
from zenoh_tf.errors import InvalidArgumentException, TransformException


def drain(log: ChangeLog, replay: ChangeReplay, position: int) -> int:
    """Apply all that is there after `position`; return the new position."""
    while True:
        first, last, lost, changes = log.take(1 << 14)
        assert not lost
        assert first == position + 1
        if changes is not None:
            replay.apply(last, changes)
        if last == position:
            return position
        position = last


@pytest.mark.parametrize("max_frames", [64, FEW_FRAMES])
@pytest.mark.parametrize("concurrency", CONTROLS)
def test_a_snapshot_and_the_changes_after_it_are_the_tree(
    concurrency: str, max_frames: int
) -> None:
    orphans = 0
    for seed in range(40 if max_frames == 64 else 80):
        tree, log = logged(concurrency, max_frames)
        writer = Writer(tree, seed, visits=max_frames == FEW_FRAMES)
        for _ in range(seed % 7 * 30):
            writer.write()
        position = log.start()
        for _ in range(30):
            writer.write()
        mirror = Mirror()

        def pause(writer: Writer = writer) -> None:
            for _ in range(5):
                writer.write()

        seq, complete = mirror.load(log, 256, pause)
        assert position <= seq <= complete
        # What was taken before the snapshot's number is in it.
        while position < seq:
            _, position, lost, changes = log.take(1)
            assert not lost
            if changes is not None:
                orphans += len(Changes(changes).lost)
                if position > seq:
                    mirror.replay.apply(position, changes)
        position = drain(log, mirror.replay, position)
        assert state(mirror.tree) == state(tree), f"seed {seed}"
        for _ in range(60):
            writer.write()
        position = drain(log, mirror.replay, position)
        assert position == log.last
        assert state(mirror.tree) == state(tree), f"seed {seed}"
        for _ in range(100):
            writer.write()
            position = drain(log, mirror.replay, position)
        assert state(mirror.tree) == state(tree), f"seed {seed}"
    assert (orphans > 0) == (max_frames == FEW_FRAMES)


@pytest.mark.parametrize("max_frames", [64, FEW_FRAMES])
@pytest.mark.parametrize("concurrency", CONTROLS)
def test_concurrent_writers_are_mirrored(concurrency: str, max_frames: int) -> None:
    tree, log = logged(concurrency, max_frames)
    position = log.start()
    writers = [Writer(tree, seed, visits=max_frames == FEW_FRAMES) for seed in range(3)]
    mirrors: list[Mirror] = []
    with beside(*(writer.write_until for writer in writers)):
        for _ in range(4):
            mirror = Mirror()
            _, complete = mirror.load(log, 256, lambda: None)
            mirrors.append(mirror)
            while position < complete:
                first, last, lost, changes = log.take(1 << 14)
                assert not lost
                assert first == position + 1
                position = last
                if changes is not None:
                    for each in mirrors:
                        each.replay.apply(last, changes)
                else:
                    log.wait(0.1)
    while position < log.last:
        _, position, lost, changes = log.take(1 << 14)
        assert not lost
        if changes is not None:
            for each in mirrors:
                each.replay.apply(position, changes)
    expected = state(tree)
    for mirror in mirrors:
        assert state(mirror.tree) == expected


@pytest.mark.parametrize("late_rows", [1, 3])
def test_rows_dropped_beside_the_first_reparenting_leave_one_version(late_rows: int) -> None:
    """The first reparenting gives every frame a new version: also one whose rows are all too old,
    in whose transactions a mirror would conflict otherwise."""
    tree, log = logged()
    position = log.start()

    def commit(*links: tuple[str, str, int]) -> None:
        rows = TransformRows.of([StampedTransform(*link, Transform()) for link in links])
        tree._commit_rows(rows, drop_old=True)

    commit(("map", "f", 1000), ("map", "f", 1100), ("map", "g", 1000), ("map", "g", 1100))
    commit(("world", "odom", 1100), ("world", "map", 1100))
    mirror = Mirror()
    position = drain(log, mirror.replay, position)
    commit(("odom", "g", 1101), *[("map", "f", stamp) for stamp in range(late_rows)])
    drain(log, mirror.replay, position)
    assert tree.frame("f").samples == 2
    assert state(mirror.tree) == state(tree)


def test_a_consumer_that_is_too_slow_learns_it() -> None:
    tree = make_tree(max_log_bytes=1 << 12)
    log = ChangeLog(tree)
    writer = Writer(tree, 1)
    log.start()
    lost = False
    for _ in range(200):
        writer.write()
    while not lost:
        first, last, lost, _ = log.take(1 << 30)
        assert lost or last >= first
    assert log.nbytes <= 1 << 12
    mirror = Mirror()
    position = log.start()
    mirror.load(log, 1 << 20, lambda: None)
    for _ in range(5):
        writer.write()
    drain(log, mirror.replay, position)
    assert state(mirror.tree) == state(tree)


def test_a_stopped_log_keeps_nothing() -> None:
    tree, log = logged()
    writer = Writer(tree, 2)
    log.start()
    for _ in range(50):
        writer.write()
    assert log.nbytes > 0
    log.stop()
    assert log.nbytes == 0
    for _ in range(50):
        writer.write()
    assert log.nbytes == 0
    position = log.start()
    assert log.take(1 << 20) == (position + 1, position, False, None)


def test_refused_and_empty_commits_leave_empty_entries() -> None:
    tree, log = logged()
    position = log.start()
    assert tree.set_transform(StampedTransform("map", "base", 1000, Transform()))
    with pytest.raises(TransformException):
        tree._commit_rows(
            TransformRows.of([StampedTransform("map", "base", 2000, Transform())]),
            read_names=["base"],
            read_versions=np.array([400], np.uint64),
        )
    assert not tree.set_transform(StampedTransform("map", "base", 1, Transform()))  # too old
    assert log.last == position + 2
    first, last, lost, changes = log.take(1)
    assert (first, last, lost) == (position + 1, position + 1, False)
    assert changes is not None
    assert log.take(1) == (position + 2, position + 2, False, None)


def test_a_tree_without_a_log_has_none() -> None:
    with pytest.raises(InvalidArgumentException, match="max_log_bytes"):
        ChangeLog(TransformTree())


def test_a_waiting_lookup_is_woken_by_a_replay() -> None:
    tree, log = logged()
    mirror = Mirror()
    position = log.start()
    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(mirror.tree.lookup_transform, "map", "base", timeout_s=30)
        tree.set_transform(StampedTransform("map", "base", 7, Transform((1, 2, 3))))
        while mirror.tree.stats()["waiters"] == 0:
            pass
        drain(log, mirror.replay, position)
        assert found.result(30).stamp_ns == 7


def message_of(**columns: Any) -> bytes:
    """Changes or frames with these columns."""
    return wire.pack(
        {
            name: column.tobytes() if isinstance(column, np.ndarray) else column
            for name, column in columns.items()
        }
    )


ONE_SAMPLE = {
    "names": ["map", "base"],
    "authorities": [""],
    "kind": np.zeros(1, np.uint8),
    "frame": np.ones(1, np.uint32),
    "version": np.array([4], np.uint64),
    "parent": np.zeros(1, np.uint32),
    "authority": np.zeros(1, np.uint32),
    "stamp": np.array([7]),
    "pose": np.array([[0, 0, 0, 0, 0, 0, 1.0]]),
    "lost": b"",
}


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"names": ["base", "base"]}, "names"),
        ({"names": ["map", ""]}, "names"),
        ({"version": np.array([5], np.uint64)}, "version"),
        ({"version": np.array([0], np.uint64)}, "version"),
    ],
)
def test_changes_that_no_tree_makes_are_refused(change: dict[str, Any], field: str) -> None:
    """Malformed columns are refused before: tests/streams/test_wire_stream.py."""
    mirror = Mirror()
    with pytest.raises(InvalidArgumentException) as error:
        mirror.replay.apply(1, message_of(**ONE_SAMPLE | change))
    assert error.value.field == field
    assert mirror.tree.frames() == []
    mirror.replay.apply(1, message_of(**ONE_SAMPLE))
    assert mirror.tree.parent("base") == "map"


def test_a_name_at_two_indexes_is_refused() -> None:
    """Its frame would be locked twice, for ever."""
    mirror = Mirror()
    texts = {"names": ["a", "a"], "authorities": [""]}
    two = np.arange(2, dtype=np.uint32)
    version, zeros = np.array([4, 8], np.uint64), bytes(8)
    none = dict.fromkeys(("parent", "authority", "stamp", "pose", "lost"), b"")
    with pytest.raises(InvalidArgumentException, match="twice"):
        mirror.replay.apply(
            1, message_of(**texts, kind=b"\2\2", frame=two, version=version, **none)
        )
    roots: dict[str, Any] = {"static": bytes(2), "authority": zeros, "count": zeros}
    none = dict.fromkeys(("stamp", "parent", "pose"), b"")
    with pytest.raises(InvalidArgumentException, match="twice"):
        mirror.replay.load(message_of(**texts, frame=two, version=version, **roots, **none))
    assert mirror.tree.frames() == []


def test_changes_are_written_as_msgpack_writes_them() -> None:
    """The order of the fields is the protocol's, and no number takes more bytes than it needs."""
    tree, log = logged()
    log.start()
    for i in range(300):
        tree.set_transform(StampedTransform("m" * 40, f"f{i % 9}", i, Transform()))
    tree.remove_frame("f8")
    for message in (log.take(1 << 20)[3], log.read_snapshot(0, 1 << 30, 1 << 30)[1]):
        assert message is not None
        pairs = msgpack.unpackb(message, object_pairs_hook=list)  # one key may come several times
        assert msgpack.Packer().pack_map_pairs(pairs) == message
