"""Messages of many changes: a mirror is exactly the tree, and its readers hardly wait."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.support.logged_trees import FEW_FRAMES, Mirror, Writer, logged, state
from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeLog, ChangeReplay, Changes, TransformRows


@pytest.mark.parametrize("seed", range(6))
def test_long_messages_are_the_tree(seed: int) -> None:
    """One message changes a mirror as its commits do one by one: also where the changes of a frame
    are so many that they are written beside it first."""
    tree, log = logged(max_frames=FEW_FRAMES)
    writer = Writer(tree, seed, visits=True)
    position = log.start()
    mirror, long = Mirror(), Mirror()
    for each in (mirror, long):
        each.load(log, 1 << 20, lambda: None)
    for _ in range(20):
        for _ in range(200):
            writer.write()
        taken = []
        while position < log.last:
            _, position, lost, changes = log.take(1)
            assert not lost
            if changes is not None:
                taken.append(changes)
                mirror.replay.apply(position, changes)
        long.replay.apply(position, together(taken))
        assert state(mirror.tree) == state(long.tree) == state(tree)


def together(messages: list[bytes]) -> bytes:
    """The changes of several messages as one."""
    all_columns = [Changes(each) for each in messages]
    names = list({name: None for each in all_columns for name in each.names})
    authorities = list({name: None for each in all_columns for name in each.authorities})
    fields: dict[str, Any] = {"names": names, "authorities": authorities}
    for column in ("kind", "frame", "version", "parent", "authority", "stamp", "pose", "lost"):
        parts = []
        for each in all_columns:
            part = getattr(each, column)
            if column in ("frame", "parent", "lost"):
                part = renumbered(part, each.names, names)
            elif column == "authority":
                part = renumbered(part, each.authorities, authorities)
            parts.append(part)
        fields[column] = np.concatenate(parts).tobytes()
    return wire.pack(fields)


def renumbered(column: Any, old: Sequence[str], new: list[str]) -> Any:
    none = (1 << 32) - 1
    return np.array([none if i == none else new.index(old[i]) for i in column], np.uint32)


def test_many_late_samples_cost_a_mirror_no_more_than_the_tree() -> None:
    """16,000 late rows took 4.8 s beside 7 ms in the tree, and readers of the mirror waited."""
    options = {"max_samples_per_frame": 65536, "max_log_bytes": 256 << 20}
    tree = TransformTree(1000.0, **options)  # type: ignore[arg-type]
    log = ChangeLog(tree)
    pose = np.array([[0, 0, 0, 0, 0, 0, 1.0]])

    def commit(stamps: Any) -> None:
        n = len(stamps)
        zero, one = np.zeros(n, np.uint32), np.ones(n, np.uint32)
        rows = TransformRows(["map", "base"], zero, one, stamps, np.repeat(pose, n, 0))
        tree._commit_rows(rows)

    commit(1_000_000 * np.arange(1, 20_001))
    mirror = TransformTree(1000.0, **options)  # type: ignore[arg-type]
    replay = ChangeReplay(mirror)
    position = log.start()
    _, frames = log.read_snapshot(0, 2, 1 << 30)
    replay.load(frames)
    begin_s = time.thread_time()
    commit(1_000_000 + 500_000 * np.arange(16_000) + 1)
    middle_s = time.thread_time()
    first, last, lost, changes = log.take(1 << 30)
    assert (first, last, lost) == (position + 1, position + 1, False)
    assert changes is not None
    between_s = time.thread_time()
    replay.apply(last, changes)
    end_s = time.thread_time()
    # Processor time: it was 400 times as much, and is about twice.
    assert end_s - between_s < 30 * (middle_s - begin_s)
    assert state(mirror) == state(tree)
