"""The calls of an interest's reader: newest samples only, waiting, limits and counts."""

from __future__ import annotations

import threading
import time

import pytest

from tests.support.logged_trees import LOG_BYTES, MANY, Mirror, follow, logged, make_tree, state
from zenoh_tf import StampedTransform, Transform
from zenoh_tf._core import Changes, InterestReader, wait_for_changes
from zenoh_tf.errors import InvalidArgumentException, LimitExceeded


def test_newest_samples_only() -> None:
    tree, log = logged()
    tree.set_transform(StampedTransform("map", "base", 100, Transform((1, 0, 0))))
    reader = InterestReader(tree, [], True)
    mirror = Mirror()
    follow(mirror, reader, begin=True)
    assert reader.has_changed()  # it is not known
    for stamp in range(101, 121):
        tree.set_transform(StampedTransform("map", "base", stamp, Transform((stamp, 0, 0))))
        tree.set_transform(StampedTransform("map", f"x{stamp}", 1, Transform()), static=True)
        if stamp % 5 == 0:
            assert follow(mirror, reader) == log.last
            assert mirror.tree.lookup_transform("map", "base").stamp_ns == stamp
            assert mirror.tree.frame("base").version == tree.frame("base").version
            assert sorted(mirror.tree.frames()) == sorted(tree.frames())
    assert [stamp for stamp, _, _ in state(mirror.tree)["base"][3]] == [100, 105, 110, 115, 120]
    tree.set_transform(StampedTransform("map", "base", 118, Transform((7, 0, 0))))
    follow(mirror, reader)  # a late sample: what is newest stays
    assert len(state(mirror.tree)["base"][3]) == 5
    tree.remove_frame("x101")
    tree.clear(keep_static=True)
    follow(mirror, reader)
    assert "x101" not in mirror.tree.frames()
    assert mirror.tree.parent("base") is None


def test_waiting_for_changes() -> None:
    tree, _ = logged()
    one = InterestReader(tree, [("map", "base")], False)
    other = InterestReader(tree, [("map", "arm")], False)
    for reader in (one, other):
        assert wait_for_changes([reader], 0.001, 0) == [0]  # it was never read
        reader.read(False, MANY)
    assert wait_for_changes([one, other], 0.001, 0.01) == []
    tree.set_transform(StampedTransform("map", "arm", 1, Transform()))
    assert wait_for_changes([one, other], 0.001, 10) == [0, 1]  # "map" is there for both
    one.read(False, MANY)
    other.read(False, MANY)
    tree.set_transform(StampedTransform("map", "arm", 2, Transform()))
    assert wait_for_changes([one, other], 0.001, 10) == [1]


def test_limits_and_arguments() -> None:
    tree, _ = logged()
    for i in range(20):
        tree.set_transform(StampedTransform(f"f{i}", f"f{i + 1}", 1, Transform()))
    reader = InterestReader(tree, [("f0", "f20")], False)
    with pytest.raises(LimitExceeded) as caught:
        reader.read(True, 10)
    assert caught.value.field == "interest_frames"
    everything = reader.read(True, 21)[3]
    assert everything is not None and len(Changes(everything).names) == 21
    with pytest.raises(InvalidArgumentException):
        InterestReader(make_tree(), [], True)


def test_counting_does_not_wait_for_a_read() -> None:
    """The server counts for its statistics, beside reads that may take long."""
    tree = make_tree(max_frames=256, max_log_bytes=LOG_BYTES)
    for i in range(100):
        tree.set_transform(StampedTransform(f"f{i}", f"f{i + 1}", 1, Transform()))
    reader = InterestReader(tree, [("f0", "f100")] * 20_000, False)
    reading = threading.Thread(target=reader.read, args=(True, MANY))
    reading.start()
    counts = 0
    while reading.is_alive():
        assert reader.frames in (0, 101)
        counts += 1
        time.sleep(0.0001)
    assert counts > 20
