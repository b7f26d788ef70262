"""The controls and figures beside the scene."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from tests.viewer.viewers import S, Tree, click, opened, step
from zenoh_tf_tools.doctor import CATALOGUE, Finding
from zenoh_tf_tools.viewer import scene
from zenoh_tf_tools.viewer.controls.clock import Clock
from zenoh_tf_tools.viewer.viewer import Viewer


def test_an_empty_tree_says_what_to_do(viewer: Viewer, tree: Tree) -> None:
    assert step(viewer) == {}
    assert "zenoh-tf set map base_link" in viewer.panel.status.content
    tree.set("map", "base", 1)
    step(viewer)
    assert "zenoh-tf set" not in viewer.panel.status.content


def test_hidden_frames(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("base", "arm", 1)
    tree.set("arm", "tool", 1)
    step(viewer)
    listed = viewer.panel.frames
    assert [line.label.strip() for line in listed._lines[:4]] == ["map", "base", "arm", "tool"]
    listed._lines[2].value = False
    step(viewer)
    assert set(step(viewer)) == {"map", "base"}  # and what hangs on it
    assert len(viewer.scene._links.handle.points) == 1
    listed._lines[3].value = True
    step(viewer)
    assert set(step(viewer)) == {"map", "base", "tool"}
    listed.search.value = "ARM"
    listed._clicked.append("show")
    step(viewer)
    assert [line.visible for line in listed._lines[:4]] == [True, True, True, False]
    assert set(step(viewer)) == {"map", "base", "arm", "tool"}
    listed.search.value = "tool"
    listed._clicked.append("only these")
    step(viewer)
    assert set(step(viewer)) == {"tool"}
    assert "1 of 4 frames, 3 hidden" in listed._count.content


def test_many_frames_are_listed_in_pages(viser_server: Any, tree: Tree) -> None:
    for number in range(500):
        tree.set("map", f"f{number:03}", number)
    with opened(viser_server, tree, max_frames=1000) as viewer:
        step(viewer)
        listed = viewer.panel.frames
        assert "501 of 501 frames, page 1 of 26" in listed._count.content
        listed._turned.extend([1, 1])
        step(viewer)
        assert "page 3 of 26" in listed._count.content
        assert listed._lines[0].label.strip() == "f039"
        listed.search.value = "f49"
        step(viewer)
        assert "10 of 501 frames" in listed._count.content


def test_a_fault_is_shown_at_its_link(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("map", "other", 2)
    step(viewer)
    fault = CATALOGUE[0]
    viewer.findings._found = [Finding(fault, "base", "<b>evidence</b>")]
    base = step(viewer)["base"]
    assert base.label == f"base: {fault.title}"
    assert base.colour == scene.FAULTY
    assert fault.id in viewer.panel.faults.content
    assert "&lt;b&gt;evidence" in viewer.panel.faults.content
    assert fault.id not in viewer.panel.figures.content
    viewer.panel.select("base")
    step(viewer)
    assert fault.id in viewer.panel.figures.content


def test_trees_that_are_not_connected(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("base", "arm", 1)
    tree.set("world", "ball", 1)
    assert set(step(viewer)) == {"map", "base", "arm"}
    assert "2 not connected to map, below: world" in viewer.panel.status.content
    viewer.panel.select("ball")
    step(viewer)
    assert "not connected to map" in viewer.panel.figures.content
    viewer.panel._fixed.value = "ball"
    assert set(step(viewer)) == {"world", "ball"}


def test_figures_of_the_clicked_frame(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1, authority="wheels")
    tree.time_ns += S // 2
    step(viewer)
    click(viewer, "base")
    step(viewer)
    text = re.sub(r"<[^>]*>", " ", viewer.panel.figures.content)
    for part in ("base", "map", "wheels", "500 ms", "in map", "1.000, 0.000, 0.000 m"):
        assert part in text
    assert step(viewer)["base"].colour == scene.SELECTED


def test_names_are_no_html(viewer: Viewer, tree: Tree) -> None:
    """viser's pages execute expressions in Markdown, so there is none."""
    evil = "<img src=x onerror=alert(1)>{alert(2)}"
    tree.set("map", evil, 1, stamp_ns=1, authority=evil)
    tree.set("elsewhere", "x", 1)
    tree.time_ns = 60 * S
    step(viewer)
    viewer.panel.select(evil)
    step(viewer)
    for handle in (viewer.panel.figures, viewer.panel.status):
        assert "<img" not in handle.content
        assert "&lt;img" in handle.content


def test_a_recording_plays_to_its_end(viser_server: Any) -> None:
    clock = Clock(viser_server.gui, (5 * S, 7 * S), 5 * S + S // 2)
    assert clock.next_ns(1.0, 0) == 5 * S + S // 2  # it does not play
    clock.play.value = True
    clock._speed.value = "2 x"
    assert clock.next_ns(0.25, 0) == 6 * S
    assert clock.next_ns(10.0, 0) == 7 * S
    assert not clock.running
    clock._slider.value = 0.5  # what viser's thread does
    assert clock.next_ns(1.0, 0) == 5 * S + S // 2
    viser_server.gui.reset()


def test_a_step_ends_at_a_sample_to_the_nanosecond(viser_server: Any) -> None:
    """The slider has hundredths of a second only."""
    clock = Clock(viser_server.gui, (5 * S, 7 * S), 5 * S)
    clock.play.value = True
    clock._steps.extend([1, -1])  # what viser's thread does
    assert clock.steps() == [1, -1]
    assert clock.steps() == []
    assert clock.step_to(5 * S + 123_456_789) == 5 * S + 123_456_789
    assert not clock.running
    assert clock.next_ns(1.0, 0) == 5 * S + 123_456_789
    assert clock.step_to(9 * S) == 7 * S
    viser_server.gui.reset()


def test_a_live_tree_pauses(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    step(viewer)
    viewer.panel.clock.play.value = False
    tree.time_ns = 5 * S
    step(viewer)
    assert "at 1.000 s" in viewer.panel.status.content
    viewer.panel.clock._steps.append(1)
    step(viewer)
    assert "at 1.100 s" in viewer.panel.status.content
    viewer.panel.clock.play.value = True
    step(viewer)
    assert "at 5.000 s" in viewer.panel.status.content


def test_a_live_tree_is_shown_as_it_was_some_seconds_ago(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.time_ns = 50 * S
    step(viewer)
    clock = viewer.panel.clock
    assert clock._slider.value == 0 and clock.running
    clock._slider.value = -2.5  # what a person does
    tree.time_ns = 51 * S
    step(viewer)
    assert not clock.running  # it does not go on
    assert "at 47.500 s" in viewer.panel.status.content
    clock._slider.value = -1.0
    step(viewer)
    assert "at 49.000 s" in viewer.panel.status.content
    clock._steps.append(-1)
    step(viewer)
    assert "at 48.900 s" in viewer.panel.status.content and clock._slider.value == -1.1
    clock.play.value = True
    step(viewer)
    assert "at 51.000 s" in viewer.panel.status.content and clock._slider.value == 0


def test_a_paused_picture_stays_when_the_server_forgets_its_time(
    viewer: Viewer, tree: Tree
) -> None:
    tree.set("map", "base", 1)
    step(viewer)
    viewer.panel.clock.play.value = False
    step(viewer)
    tree.set("map", "base", 2, stamp_ns=100 * S)  # the cache is of ten seconds
    drawn = step(viewer)
    np.testing.assert_allclose(drawn["base"].position, (1, 0, 0), atol=1e-6)
    viewer.panel._fixed.value = "base"
    step(viewer)
    np.testing.assert_allclose(step(viewer)["map"].position, (0, 1, 0), atol=1e-6)
