"""The tree of frames beside the scene."""

from __future__ import annotations

from zenoh_tf_tools.viewer.controls.frame_tree import Row, page_of, rows, with_descendants
from zenoh_tf_tools.viewer.source import ViewedLink

PARENTS = {
    "map": None,
    "base": "map",
    "arm": "base",
    "tool": "arm",
    "camera": "base",
    "ball": "sky",
}
LINKS = {
    name: ViewedLink(name, parent, True, 0, None, None, "") for name, parent in PARENTS.items()
}


def test_each_frame_stands_before_its_children() -> None:
    assert [(row.name, row.depth) for row in rows(LINKS)] == [
        ("ball", 0),  # its parent is not shown
        ("map", 0),
        ("base", 1),
        ("arm", 2),
        ("tool", 3),
        ("camera", 2),
    ]


def test_a_search_finds_frames_and_shows_where_they_hang() -> None:
    found = rows(LINKS, "CAM")
    assert found == [Row("map", 0, False), Row("base", 1, False), Row("camera", 2, True)]
    assert rows(LINKS, "nothing") == []


def test_what_hangs_on_a_frame() -> None:
    assert with_descendants(LINKS, "base") == {"base", "arm", "tool", "camera"}
    assert with_descendants(LINKS, "ball") == {"ball"}


def test_a_loop_ends() -> None:
    """Links that were read while the tree changed."""
    loop = {
        name: ViewedLink(name, parent, True, 0, None, None, "") for name, parent in ("ab", "ba")
    }
    assert rows(loop) == []
    assert with_descendants(loop, "a") == {"a", "b"}


def test_pages() -> None:
    listed = rows(LINKS)
    assert page_of(listed, 0, 4) == (0, listed[:4])
    assert page_of(listed, 7, 4) == (1, listed[4:])
    assert page_of(listed, -1, 4) == (0, listed[:4])
    assert page_of([], 3, 4) == (0, [])
