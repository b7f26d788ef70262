"""Where the viewer puts frames: as lookups of the tree say."""

from __future__ import annotations

import random

import numpy as np
import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_tools.viewer.placement import place, roots_by_size
from zenoh_tf_tools.viewer.source import ViewedLink
from zenoh_tf_tools.viewer.trails import MAX_TRAILS, trails_of

S = 10**9


def link(
    name: str, parent: str | None, at_ns: int | None = 0, age_s: float | None = 0.0
) -> ViewedLink:
    return ViewedLink(name, parent, False, at_ns, None if parent is None else age_s, None, "")


def random_tree(frames: int) -> tuple[TransformTree, dict[str, ViewedLink]]:
    chance = random.Random(7)
    tree = TransformTree()
    links = {"f0": link("f0", None, None)}
    for number in range(1, frames):
        name, parent = f"f{number}", f"f{chance.randrange(number)}"
        turn = np.array([chance.gauss(0, 1) for _ in range(4)])
        pose = Transform([chance.uniform(-2, 2) for _ in range(3)], turn / np.linalg.norm(turn))
        stamp_ns = chance.randrange(S)
        tree.set_transform(StampedTransform(parent, name, stamp_ns, pose))
        links[name] = link(name, parent, stamp_ns)
    shuffled = [*links]
    chance.shuffle(shuffled)
    return tree, {name: links[name] for name in shuffled}


@pytest.mark.parametrize("fixed", ["f0", "f17"])
def test_poses_are_those_of_latest_lookups(fixed: str) -> None:
    tree, links = random_tree(60)
    placement = place(tree, links, fixed)
    assert sorted(placement.names) == sorted(links)
    for name in links:
        expected = tree.lookup_latest_transform(fixed, name).transform.matrix()
        found = Transform.from_pose(placement.poses[placement.rows[name]]).matrix()
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_trees_that_are_not_connected_are_named() -> None:
    tree = TransformTree()
    links: dict[str, ViewedLink] = {}
    for parent, child in (("map", "base"), ("base", "arm"), ("world", "ball")):
        tree.set_transform(StampedTransform(parent, child, 1, Transform()))
        links |= {parent: links.get(parent, link(parent, None)), child: link(child, parent, 1)}
    placement = place(tree, links, "base")
    assert set(placement.names) == {"map", "base", "arm"}
    assert placement.elsewhere == {"world": 2}
    assert roots_by_size(links) == ["map", "world"]
    assert place(tree, links, "ball").elsewhere == {"map": 3}
    assert place(tree, links, "nowhere").names == []


def test_what_cannot_be_placed_is_left_out() -> None:
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 1, Transform()))
    links = {
        "map": link("map", None),
        "base": link("base", "map", 1),
        "gone": link("gone", "map", 1),  # removed since its link was read
        "below": link("below", "gone", 1),
        "empty": link("empty", "map", None),
        "a": link("a", "b", 1),  # a loop: the links were read while the tree changed
        "b": link("b", "a", 1),
    }
    assert place(tree, links, "map").names == ["map", "base"]
    assert place(tree, links, "a").names == []
    assert place(tree, {}, "map").names == []


def test_trails_have_gaps_where_there_is_no_answer() -> None:
    tree = TransformTree(cache_time_s=100)
    for i in range(101):
        tree.set_transform(StampedTransform("map", "base", i * S // 10, Transform((i / 10, 0, 0))))
    moving = [link("base", "map")]
    lines = trails_of(tree, "map", moving, 10 * S, 4.0).segments
    assert lines[0, 0, 0] == pytest.approx(6.0, abs=0.05)
    assert lines[-1, 1, 0] == pytest.approx(10.0, abs=0.05)
    assert np.all(lines[1:, 0] == lines[:-1, 1])
    assert trails_of(tree, "map", moving, 10 * S, 4.0).ends["base"][0] == pytest.approx(10.0)
    late = trails_of(tree, "map", moving, 10 * S + S // 2, 4.0)
    assert late.ends["base"][0] == pytest.approx(10.0)  # its samples come late
    # After its last sample it has no more points, and it does not go as far as its frame.
    assert trails_of(tree, "map", moving, 12 * S, 4.0).ends == {}
    assert len(trails_of(tree, "map", moving, 30 * S, 4.0).segments) == 0
    assert len(trails_of(tree, "elsewhere", moving, 10 * S, 4.0).segments) == 0
    assert len(trails_of(tree, "map", [link("base", "map", age_s=None)], 10 * S, 4.0).segments) == 0


def test_trails_are_bounded() -> None:
    tree = TransformTree(cache_time_s=1e6, max_samples_per_frame=10)
    links = []
    for number in range(2 * MAX_TRAILS):
        for stamp_s in (0, 10**5):
            tree.set_transform(
                StampedTransform("map", f"f{number}", stamp_s * S, Transform((stamp_s, 0, 0)))
            )
        links.append(link(f"f{number}", "map"))
    assert len(trails_of(tree, "map", links, 10**5 * S, 1e5).segments) <= MAX_TRAILS * 401
