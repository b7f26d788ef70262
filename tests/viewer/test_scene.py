"""What the viewer hands to a real viser server, step by step."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from tests.urdf.shapes import write_urdf
from tests.viewer.viewers import QUARTER, S, Tree, click, opened, step
from zenoh_tf import Transform
from zenoh_tf.urdf.visuals import read_visuals
from zenoh_tf_tools.viewer import scene
from zenoh_tf_tools.viewer.models import Model
from zenoh_tf_tools.viewer.viewer import Viewer


def test_frames_have_their_pose_in_the_fixed_frame(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("base", "camera", 2, static=True)
    camera = step(viewer)["camera"]
    np.testing.assert_allclose(camera.position, (1, 2, 0), atol=1e-6)
    # viser's order is w, x, y, z: two quarter turns about z.
    np.testing.assert_allclose(camera.wxyz, (0, 0, 0, 1), atol=1e-6)
    assert viewer.scene._links.handle.points.shape == (2, 2, 3)
    tree.set("map", "camera", 7, stamp_ns=2 * S, static=True)  # another parent
    np.testing.assert_allclose(step(viewer)["camera"].position, (7, 0, 0), atol=1e-6)


def test_another_fixed_frame(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    step(viewer)
    viewer.panel._fixed.value = "base"
    drawn = step(viewer)
    np.testing.assert_allclose(drawn["base"].position, (0, 0, 0), atol=1e-6)
    np.testing.assert_allclose(drawn["map"].position, (0, 1, 0), atol=1e-6)


def test_a_frame_far_from_the_origin_keeps_its_millimetres(viewer: Viewer, tree: Tree) -> None:
    """The browser computes with 32 bits, which have steps of half a metre there."""
    tree.set("earth", "base", 6_378_137.0)
    tree.set("base", "camera", 0.125, static=True)
    drawn = step(viewer)
    across = drawn["camera"].position - drawn["base"].position
    np.testing.assert_allclose(np.linalg.norm(across), 0.125, atol=1e-4)


def test_the_cameras_are_fitted_to_frames_that_come_soon_after_the_first(
    viewer: Viewer, tree: Tree
) -> None:
    """A tree that begins comes frame by frame; later ones do not take the camera from a person."""
    tree.set("map", "base", 1)
    step(viewer)
    first = np.linalg.norm(viewer._server.initial_camera.position)
    tree.set("map", "far", 100)
    step(viewer)
    second = np.linalg.norm(viewer._server.initial_camera.position)
    assert second > 10 * first
    viewer._fit_until_s = 0.0
    tree.set("map", "further", 1000)
    step(viewer)
    assert np.linalg.norm(viewer._server.initial_camera.position) == second
    viewer.panel.pressed.append("show all")
    step(viewer)
    assert np.linalg.norm(viewer._server.initial_camera.position) > 5 * second


def test_the_camera_follows_a_frame(viewer: Viewer, tree: Tree) -> None:
    """The scene moves under the camera, so a person can turn it meanwhile."""
    tree.set("map", "base", 1)
    tree.set("map", "other", 5)
    before = step(viewer)
    viewer.panel.select("base")
    viewer.panel.follow.value = True
    step(viewer)
    tree.set("map", "base", 4, stamp_ns=S + 1)
    after = step(viewer)
    np.testing.assert_allclose(after["base"].position, before["base"].position, atol=1e-6)
    np.testing.assert_allclose(
        after["other"].position, before["other"].position - (3, 0, 0), atol=1e-6
    )
    assert "the camera follows base" in viewer.panel.status.content
    viewer.panel.select("other")  # picking another one does not make the camera jump
    tree.set("map", "base", 6, stamp_ns=S + 2)
    np.testing.assert_allclose(step(viewer)["base"].position, before["base"].position, atol=1e-6)


def test_there_must_be_a_frame_to_follow(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    step(viewer)
    viewer.panel.follow.value = True
    step(viewer)
    assert not viewer.panel.follow.value


def test_a_robots_shapes(viser_server: Any, tree: Tree, tmp_path: Path) -> None:
    """They are drawn at every frame that has the link's name, with any prefix."""
    models = [Model(visual) for visual in read_visuals(write_urdf(tmp_path))]
    tree.set("map", "r1/box_link", 3)
    tree.set("map", "my_box_link", 4)
    with opened(viser_server, tree, models) as viewer:
        step(viewer)
        assert {model.link for model in viewer.models._nodes} == {"box_link"}
        for model, node in viewer.models._nodes.items():
            frame = Transform((3, 0, 0), QUARTER) @ Transform.from_pose(model.origin)
            expected = frame.translation - viewer.scene.origin
            np.testing.assert_allclose(node.handle.batched_positions, [expected], atol=1e-6)
        tree.set("map", "r2/box_link", 5)
        step(viewer)
        handles = [node.handle for node in viewer.models._nodes.values()]
        assert {len(x.batched_positions) for x in handles} == {2}
        viewer.panel.robot.value = 0.5
        step(viewer)
        assert {x.opacity for x in handles} == {0.5}
        viewer.panel.robot.value = 0.0
        step(viewer)
        assert viewer.models._nodes == {}


def test_the_colours_of_instances() -> None:
    """Black, white, and half of sRGB, which is a fifth of the light."""
    np.testing.assert_array_equal(scene.linear((0, 1, 0.5)), (0, 255, 55))


def test_any_name(viewer: Viewer, tree: Tree) -> None:
    """A slash in a node's name would make it another one's child."""
    names = ["robot", "robot/arm", "robot%2Farm", "robot//arm", "..", "a b", "\u00e4\u202e"]
    for number, name in enumerate(names):
        tree.set("map", name, number)
    drawn = step(viewer)
    assert set(drawn) == {"map", *names}
    paths = [label.handle.name for _, label in viewer.scene._labels.values()]
    assert len(set(paths)) == len(paths)
    assert all(re.fullmatch(r"/names/\d+/text", path) for path in paths)
    assert "\u202e" not in (drawn["\u00e4\u202e"].label or "")


def test_stale_links_are_marked(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("base", "camera", 1, static=True)
    base = step(viewer)["base"]
    assert (base.label, base.colour) == ("base", scene.FRESH)
    tree.time_ns += 2 * S
    base = step(viewer)["base"]
    assert (base.label, base.colour) == ("base (stale)", scene.STALE)
    colours = viewer.scene._links.handle.colors[:, 0].tolist()
    assert colours == [[*scene.STALE], [*scene.STATIC]]
    assert "1 stale (over 1 s): base" in viewer.panel.status.content


def test_a_link_that_has_not_begun_is_not_stale(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1, stamp_ns=5 * S)
    base = step(viewer)["base"]
    assert (base.label, base.colour) == ("base (not yet)", scene.AWAITED)
    assert "1 not yet: base" in viewer.panel.status.content
    assert "stale" not in viewer.panel.status.content
    tree.time_ns = 5 * S
    assert step(viewer)["base"].label == "base"


def test_frames_come_and_go(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    tree.set("map", "other", 2)
    assert set(step(viewer)) == {"map", "base", "other"}
    tree.lookups.remove_frame("base")
    assert set(step(viewer)) == {"map", "other"}
    tree.set("map", "new", 0.5)
    drawn = step(viewer)
    assert set(drawn) == {"map", "other", "new"}
    assert drawn["new"].label == "new"
    np.testing.assert_allclose(drawn["new"].position, (0.5, 0, 0), atol=1e-6)
    click(viewer, "new")
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


def test_a_limit_of_frames(viser_server: Any, tree: Tree) -> None:
    for number in range(30):
        tree.set("map", f"f{number}", 1)
    with opened(viser_server, tree, max_frames=10) as viewer:
        shown = set(step(viewer))
        assert len(shown) == 10
        assert "21 more frames are not shown (--max-frames)" in viewer.panel.status.content
        for number in range(30, 40):
            tree.set("map", f"f{number}", 1)
        assert set(step(viewer)) == shown  # those that are drawn stay


def test_trails_and_trouble(viewer: Viewer, tree: Tree) -> None:
    for i in range(10):
        tree.set("map", "base", i, stamp_ns=S + i * S // 10)
    tree.time_ns = 2 * S
    tree.reported = "no heartbeat from the server for 5 s"
    step(viewer)
    assert len(viewer.scene._trails.handle.points) > 10
    assert "no heartbeat from the server for 5 s" in viewer.panel.status.content
    viewer.panel.trail.value = 0.0
    step(viewer)
    assert len(viewer.scene._trails.handle.points) == 0


def test_a_trail_goes_as_far_as_its_frame(viewer: Viewer, tree: Tree) -> None:
    """Trails are drawn less often than frames, so the last bit of one is a line of its own."""
    for i in range(10):
        tree.set("map", "base", i, stamp_ns=S + i * S // 10)
    tree.time_ns = 2 * S
    drawn = step(viewer)
    trail, head = viewer.scene._trails.handle, viewer.scene._heads.handle
    assert len(head.points) == 1
    np.testing.assert_allclose(head.points[0, 0], trail.points[-1, 1], atol=1e-6)
    tree.set("map", "base", 12, stamp_ns=2 * S)
    viewer._slow_at_s = float("inf")
    viewer.step()
    np.testing.assert_allclose(head.points[0, 0], trail.points[-1, 1], atol=1e-6)
    where = np.add(drawn["map"].position, (12, 0, 0))
    np.testing.assert_allclose(head.points[0, 1], where, atol=1e-6)
    tree.lookups.remove_frame("base")
    step(viewer)
    assert len(head.points) == 0


def test_nothing_is_sent_when_nothing_changes(viewer: Viewer, tree: Tree) -> None:
    tree.set("map", "base", 1)
    step(viewer)
    sent: list[str] = []

    class Recorder:
        def __setattr__(self, name: str, value: object) -> None:
            sent.append(name)

    drawn = viewer.scene
    for node in (drawn._axes, drawn._origins, drawn._links, *drawn._labels["base"]):
        node.handle = Recorder()
    viewer._slow_at_s = 0.0
    viewer.step()
    assert sent == []
    tree.set("map", "base", 0.9, stamp_ns=S + 1)
    tree.time_ns += 1
    viewer.step()
    assert sent == ["batched_positions", "batched_positions", "points", "position"]


def test_the_scene_cannot_be_shared(viser_server: Any) -> None:
    """Neither by the button, nor by the message that it would send."""
    assert viser_server.request_share_url() is None
    messages = viser_server.gui._websock_interface._broadcast_buffer.message_from_id.values()
    shown = [m.show_share_button for m in messages if hasattr(m, "show_share_button")]
    assert shown == [False]
