"""The picked frame as it is now, by an estimate."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.moving_arm import MS, fill
from tests.viewer.viewers import S, Tree, step
from zenoh_tf import Transform
from zenoh_tf_tools.estimate_words import bounds, carried_on
from zenoh_tf_tools.viewer.viewer import Viewer

END_NS = 10**18
NOW_NS = END_NS + 30 * MS


@pytest.fixture
def picked(viewer: Viewer, tree: Tree) -> Viewer:
    """A viewer of a moving arm, whose tool is picked, 30 ms after the newest samples."""
    fill(tree.lookups, END_NS)
    tree.time_ns = NOW_NS
    step(viewer)
    viewer.panel.select("tool")
    step(viewer)
    return viewer


def error_now(viewer: Viewer) -> str:
    """What the panel says about the error; empty if it says nothing."""
    text: str = viewer.panel.figures.content
    return text.partition(">error now<")[2].partition("<td>")[2].partition("</td>")[0]


def radius(viewer: Viewer) -> float:
    """Of the ball; its axes are there as long as it is."""
    ghost = viewer.ghost
    radius_m = float(ghost._ball.handle.batched_scales[0])
    assert (ghost._axes.handle.batched_scales > 0).all() == (radius_m > 0)
    return radius_m


def test_where_it_is_and_how_wrong_that_may_be(picked: Viewer, tree: Tree) -> None:
    found = tree.lookups.estimate_transform("map", "tool", NOW_NS)
    ghost = picked.ghost
    assert radius(picked) == pytest.approx(found.error_m)
    axes, ball = ghost._axes.handle, ghost._ball.handle
    for places in (axes.batched_positions, ball.batched_positions):
        where = np.tile(found.transform.translation, (len(places), 1))
        np.testing.assert_allclose(places + picked.scene.origin, where, atol=1e-6)
    # The rod of each axis is one along z, turned.
    for wxyz, axis in zip(axes.batched_wxyzs, np.eye(3), strict=True):
        w, x, y, z = wxyz.tolist()
        np.testing.assert_allclose(
            Transform(rotation=(x, y, z, w)).apply_vectors([(0, 0, 1)]),
            found.transform.apply_vectors([axis]),
            atol=1e-6,
        )
    assert error_now(picked) == bounds(found)
    assert f"{carried_on(found)}</td>" in picked.panel.figures.content
    assert carried_on(found).startswith("30 ms: base by ")
    # As long as those of the picked frame, which is beside it.
    length_m = step(picked)["tool"].axes_m
    np.testing.assert_allclose(axes.batched_scales, length_m)
    tree.time_ns += 50 * MS
    step(picked)
    assert radius(picked) > found.error_m


def test_no_ghost_without_an_estimate(picked: Viewer, tree: Tree) -> None:
    tree.time_ns = END_NS + 2 * S
    step(picked)
    assert radius(picked) == 0
    assert error_now(picked).startswith("no estimate: ")
    assert "base" in error_now(picked)
    tree.time_ns = NOW_NS
    step(picked)
    assert radius(picked) > 0


def test_no_ghost_of_what_has_no_error(picked: Viewer) -> None:
    picked.panel._fixed.value = "arm"
    step(picked)
    step(picked)
    assert radius(picked) == 0
    assert error_now(picked) == "none: all links are static"


def test_no_ghost_without_a_bound(picked: Viewer, tree: Tree) -> None:
    tree.set("map", "new", 1, stamp_ns=END_NS)
    step(picked)
    picked.panel.select("new")
    step(picked)
    assert radius(picked) == 0
    assert error_now(picked).startswith("within any length")


def test_no_ghost_of_the_past_or_of_a_hidden_frame(picked: Viewer) -> None:
    picked.panel.clock.play.value = False
    step(picked)
    assert radius(picked) == 0
    assert error_now(picked) == ""
    picked.panel.clock.play.value = True
    picked.panel.frames.unchecked.add("tool")
    step(picked)
    assert radius(picked) == 0
    picked.panel.frames.unchecked.clear()
    step(picked)
    assert radius(picked) > 0
    picked.panel.estimate.value = False
    step(picked)
    assert radius(picked) == 0
    assert error_now(picked) == ""
