"""The queue of woken lookups lets go of everything when it is closed."""

import gc
import weakref

import numpy as np

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import ParkedLookups, WakeQueue, park_lookups

WANTED_NS = 5000


def set_base(tree: TransformTree, stamp_ns: int) -> None:
    tree.set_transform(StampedTransform("map", "base", stamp_ns, Transform()))


def parked(tree: TransformTree, queue: WakeQueue) -> ParkedLookups:
    """A lookup that waits for the pose of base in map at a later time."""
    zero, one = np.zeros(1, np.uint32), np.ones(1, np.uint32)
    names, op, stamp = ["map", "base"], np.zeros(1, np.uint8), np.array([WANTED_NS])
    lookups = park_lookups(tree, queue, 7, names, op, zero, one, stamp)
    assert not lookups.start()
    return lookups


def test_a_closed_queue_keeps_no_tree_alive() -> None:
    for commits_before_close in (True, False):
        tree, queue = TransformTree(), WakeQueue()
        set_base(tree, 1000)
        lookups = parked(tree, queue)
        if commits_before_close:
            set_base(tree, WANTED_NS)  # the row is in the queue
        queue.close()
        if not commits_before_close:
            set_base(tree, WANTED_NS)  # the row is woken, but nobody will read it
        lookups.cancel()
        alive = weakref.ref(tree)
        del lookups, tree
        gc.collect()
        assert alive() is None
        assert queue.take() is None


def test_an_open_queue_gives_what_was_woken() -> None:
    tree, queue = TransformTree(), WakeQueue()
    set_base(tree, 1000)
    lookups = parked(tree, queue)
    set_base(tree, WANTED_NS)
    assert queue.take() == [7]
    del lookups
    queue.close()
