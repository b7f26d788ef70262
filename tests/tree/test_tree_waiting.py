"""Lookups of the embedded tree that wait for a write."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.support.small_robot import link
from zenoh_tf import (
    BackwardExtrapolationException,
    ForwardExtrapolationException,
    InvalidArgumentException,
    TransformTree,
)

S = 1_000_000_000


def test_a_lookup_waits_for_the_write_that_it_needs(tree: TransformTree) -> None:
    with ThreadPoolExecutor(3) as pool:
        tool = pool.submit(tree.lookup_transform, "map", "tool", 15 * S, 20.0)
        can = pool.submit(tree.can_transform, "map", "tool", None, 20.0)
        base = pool.submit(tree.lookup_transform, "map", "base", 25 * S, 20.0)
        time.sleep(0.05)
        assert not (tool.done() or can.done() or base.done())
        tree.set_transforms_xact([link("arm", "tool", 15 * S), link("arm", "tool", 16 * S)])
        assert tool.result().stamp_ns == 15 * S
        assert can.result() is True
        assert not base.done()
        tree.set_transform(link("map", "base", 26 * S, 26.0))
        assert base.result().transform.pose()[0] == pytest.approx(25.0)


def test_waiting_ends(tree: TransformTree) -> None:
    with pytest.raises(ForwardExtrapolationException, match="waited"):
        tree.lookup_transform("map", "base", 25 * S, timeout_s=0.05)
    assert not tree.can_transform("map", "nowhere", timeout_s=0.05)
    with pytest.raises(BackwardExtrapolationException):  # too old for ever: it does not wait
        tree.lookup_transform("map", "base", 1 * S, timeout_s=300.0)
    with pytest.raises(InvalidArgumentException, match="timeout_s"):
        tree.lookup_transform("map", "base", 1, timeout_s=-1)
