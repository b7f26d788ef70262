"""J: a tree and a peer that writes to it; over the network where the tree is remote."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from zenoh_tf import LookupException, StampedTransform
from zenoh_tf_client import TransformClient

from .shorthand import Tree, assert_pose, can, look, ns, put, stamped
from .waits import LONG_S, SOON_S, asking, assert_waits

Publish = Callable[[StampedTransform], None]


@pytest.fixture
def publish(tf: Tree) -> Iterator[Publish]:
    """Publish as a sensor does: for a remote tree on its own connection, without waiting."""
    with ExitStack() as stack:
        if isinstance(tf, TransformClient):
            peer = stack.enter_context(TransformClient.connect(tf.endpoint))
            yield stack.enter_context(peer.broadcaster("sensor")).send
        else:
            yield lambda transform: (tf.set_transform(transform, "sensor"), None)[1]


def test_J01_lookup_transform_available(tf: Tree, publish: Publish) -> None:
    """A lookup asked before the transform is published gets it."""
    with asking(tf, lambda: tf.lookup_transform("a", "b", ns(1), timeout_s=LONG_S)) as answer:
        publish(stamped("a", "b", 1, (1, -2, 3)))
        assert_pose(answer.result(SOON_S), (1, -2, 3))
    assert tf.frame("b").authority == "sensor"


def test_J02_lookup_transform_timeout(tf: Tree) -> None:
    """A lookup of a transform that never arrives fails at its time-out, not before."""
    begun_s = time.monotonic()
    with pytest.raises(LookupException, match="waited"):
        tf.lookup_transform("a", "b", ns(1), timeout_s=0.5)
    assert time.monotonic() - begun_s >= 0.5


def test_J03_lookup_transform_delayed(tf: Tree, publish: Publish) -> None:
    """A lookup that has waited for a while is answered by the set."""
    with asking(tf, lambda: tf.lookup_transform("a", "b", ns(1), timeout_s=LONG_S)) as answer:
        time.sleep(0.2)
        assert_waits(tf, answer)
        publish(stamped("a", "b", 1, (1, -2, 3)))
        assert_pose(answer.result(SOON_S), (1, -2, 3))


def test_J04_buffer_client(tf: Tree) -> None:
    """A point in one frame has its coordinates in the other."""
    put(tf, "a", "b", 1, (5, 6, 7))
    for seconds in (1, None):
        point = look(tf, "b", "a", seconds).transform.apply((0, 0, 0))
        np.testing.assert_allclose(point, (-5, -6, -7), atol=1e-12)


def test_J05_unavailable(tf: Tree) -> None:
    """A missing transform raises, and can_transform returns False; the server is there."""
    put(tf, "a", "b", 1)
    with pytest.raises(LookupException) as caught:
        look(tf, "a", "nowhere")
    assert caught.value.frame == "nowhere"
    assert not can(tf, "a", "nowhere")
    assert can(tf, "a", "b")
