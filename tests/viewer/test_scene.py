"""What the viewer hands to a real viser server, step by step."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.processes.ports import free_port
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_tools.viewer import scene
from zenoh_tf_tools.viewer.panel import Panel
from zenoh_tf_tools.viewer.source import Link
from zenoh_tf_tools.viewer.viewer import Options, Viewer, close_server, open_server

S = 10**9
QUARTER = (0.0, 0.0, 0.5**0.5, 0.5**0.5)


class Tree:
    """A tree in this process, at a time that the test sets."""

    range_ns: tuple[int, int] | None = None

    def __init__(self) -> None:
        self.lookups = TransformTree()
        self.time_ns = S
        self.reported: str | None = None

    def set(self, parent: str, child: str, x: float, stamp_ns: int = S, **options: Any) -> None:
        stamped = StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0), QUARTER))
        self.lookups.set_transform(stamped, **options)

    def names(self) -> list[str]:
        return self.lookups.frames()

    def link(self, name: str, time_ns: int) -> Link | None:
        if name not in self.lookups.frames():
            return None
        frame = self.lookups.frame(name)
        stamp_ns = frame.newest_stamp_ns
        moves = not frame.static and frame.parent is not None and stamp_ns is not None
        age_s = (time_ns - (stamp_ns or 0)) / 1e9 if moves else None
        return Link(name, frame.parent, frame.static, stamp_ns, age_s, None, frame.authority)

    def now_ns(self, links: Any) -> int:
        return self.time_ns

    def trouble(self) -> str | None:
        return self.reported


@pytest.fixture(scope="module")
def server() -> Iterator[Any]:
    server = open_server("127.0.0.1", free_port())
    yield server
    close_server(server)


@pytest.fixture
def tree() -> Tree:
    return Tree()


@pytest.fixture
def viewer(server: Any, tree: Tree) -> Iterator[Viewer]:
    yield Viewer(tree, server, options())
    server.scene.reset()
    server.gui.reset()


def options(max_frames: int = 100, fixed: str | None = None) -> Options:
    return Options(
        stale_s=1.0,
        max_frames=max_frames,
        at_ns=0,
        fixed=fixed,
        axes_m=0.2,
        trail_s=5.0,
    )


def step(viewer: Viewer) -> dict[str, Any]:
    """One picture, with everything that is otherwise drawn less often."""
    viewer._slow_at_s = 0.0
    viewer.step()
    return viewer.scene._nodes


def test_frames_have_their_pose_in_the_fixed_frame(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("base", "camera", 2, static=True)
    nodes = step(viewer)
    camera = nodes["camera"].frame
    np.testing.assert_allclose(camera.position, (1, 2, 0), atol=1e-12)
    # viser's order is w, x, y, z: two quarter turns about z.
    np.testing.assert_allclose(camera.wxyz, (0, 0, 0, 1), atol=1e-12)
    links = viewer.scene._links
    assert links.points.shape == (2, 2, 3)
    tree.set("map", "camera", 7, stamp_ns=2 * S, static=True)  # another parent
    nodes = step(viewer)
    np.testing.assert_allclose(nodes["camera"].frame.position, (7, 0, 0), atol=1e-12)


def test_another_fixed_frame(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    step(viewer)
    viewer.panel._fixed.value = "base"
    nodes = step(viewer)
    np.testing.assert_allclose(nodes["base"].frame.position, (0, 0, 0), atol=1e-12)
    np.testing.assert_allclose(nodes["map"].frame.position, (0, 1, 0), atol=1e-12)


def test_any_name(viewer: Viewer, tree: Tree) -> None:
    """A slash in a node's name would make it another one's child."""
    names = ["robot", "robot/arm", "robot%2Farm", "robot//arm", "..", "a b", "\u00e4\u202e"]
    for name in names:
        tree.set("map", name, 1)
    nodes = step(viewer)
    assert set(nodes) == {"map", *names}
    paths = [node.frame.name for node in nodes.values()]
    assert len(set(paths)) == len(paths)
    assert all(re.fullmatch(r"/frames/\d+", path) for path in paths)
    assert "\u202e" not in nodes["\u00e4\u202e"].label.text


def test_stale_links_are_marked(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("base", "camera", 1, static=True)
    node = step(viewer)["base"]
    assert (node.text, tuple(node.frame.origin_color)) == ("base", scene.FRESH)
    tree.time_ns += 2 * S
    node = step(viewer)["base"]
    assert (node.label.text, tuple(node.frame.origin_color)) == ("base (stale)", scene.STALE)
    assert [tuple(pair[0]) for pair in viewer.scene._links.colours] == [scene.STALE, scene.STATIC]
    assert "1 stale (over 1 s): base" in viewer.panel.status.content


def test_frames_come_and_go(viewer: Viewer, tree: Tree) -> None:
    assert step(viewer) == {}
    tree.set("map", "base", 1)
    tree.set("map", "other", 2)
    node = step(viewer)["base"]
    tree.lookups.remove_frame("base")
    assert set(step(viewer)) == {"map", "other"}
    assert not node.frame.visible
    tree.set("map", "new", 3)
    nodes = step(viewer)
    assert set(nodes) == {"map", "other", "new"}
    assert nodes["new"].frame.visible
    assert nodes["new"].label.text == "new"
    np.testing.assert_allclose(nodes["new"].frame.position, (3, 0, 0), atol=1e-12)
    for callback in nodes["new"].frame._impl.click_cb or ():
        callback.callback(None)  # what viser's thread does
    step(viewer)
    assert viewer.panel.selected == "new"


def test_nothing_grows_as_frames_come_and_go(viewer: Viewer, tree: Tree) -> None:
    sockets: Any = viewer._server.gui._websock_interface
    kept = sockets._broadcast_buffer.message_from_id  # what new pages get
    sizes = []
    for number in range(60):
        tree.set("map", f"object {number}", 1)
        step(viewer)
        tree.lookups.remove_frame(f"object {number}")
        step(viewer)
        sizes.append(len(kept))
    assert max(sizes[5:]) <= sizes[5] + 2


def test_a_limit_of_frames(server: Any, tree: Tree) -> None:
    viewer = Viewer(tree, server, options(max_frames=10))
    for number in range(30):
        tree.set("map", f"f{number}", 1)
    shown = set(step(viewer))
    assert len(shown) == 10
    assert "21 more frames are not shown (--max-frames)" in viewer.panel.status.content
    for number in range(30, 40):
        tree.set("map", f"f{number}", 1)
    assert set(step(viewer)) == shown  # those that are drawn stay
    server.scene.reset()
    server.gui.reset()


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
    viewer._clicked.append("base")  # what viser's thread does
    step(viewer)
    text = re.sub(r"<[^>]*>", " ", viewer.panel.figures.content)
    for part in ("base", "map", "wheels", "500 ms", "1.000, 0.000, 0.000 m in map"):
        assert part in text
    assert tuple(step(viewer)["base"].frame.origin_color) == scene.SELECTED


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


def test_trails_and_trouble(viewer: Viewer, tree: Tree) -> None:
    for i in range(10):
        tree.set("map", "base", i, stamp_ns=S + i * S // 10)
    tree.time_ns = 2 * S
    tree.reported = "no heartbeat from the server for 5 s"
    step(viewer)
    assert len(viewer.scene._trails.points) > 10
    assert "no heartbeat from the server for 5 s" in viewer.panel.status.content
    viewer.panel._trail.value = 0.0
    step(viewer)
    assert len(viewer.scene._trails.points) == 0


def test_a_recording_plays_to_its_end(server: Any) -> None:
    panel = Panel(
        server, range_ns=(5 * S, 7 * S), at_ns=5 * S + S // 2, axes_m=0.2, trail_s=math.inf
    )
    assert panel.time_ns(1.0) == 5 * S + S // 2  # it does not play
    assert panel.trail_s == 60.0
    panel._play.value = True
    panel._speed.value = "2 x"
    assert panel.time_ns(0.25) == 6 * S
    assert panel.time_ns(10.0) == 7 * S
    assert not panel._play.value
    server.gui.reset()


def test_nothing_is_sent_when_nothing_changes(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    node = step(viewer)["base"]
    sent: list[str] = []

    class Recorder:
        def __setattr__(self, name: str, value: object) -> None:
            sent.append(name)

    node.frame = node.label = Recorder()
    viewer.scene._links._lines = Recorder()
    step(viewer)
    assert sent == []
    tree.set("map", "base", 2, stamp_ns=S + 1)
    tree.time_ns += 1
    step(viewer)
    assert sent == ["position", "wxyz", "points"]


def test_the_scene_cannot_be_shared(server: Any) -> None:
    """Neither by the button, nor by the message that it would send."""
    assert server.request_share_url() is None
    messages = server.gui._websock_interface._broadcast_buffer.message_from_id.values()
    shown = [m.show_share_button for m in messages if hasattr(m, "show_share_button")]
    assert shown == [False]
