"""The pose of every frame in the fixed frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import Transform, TransformArray
from zenoh_tf_tools.viewer.source import Lookups, ViewedLink


@dataclass(frozen=True)
class Placement:
    """Frames and where they are.

    Attributes:
        names: The n frames that are connected to the fixed frame, parents first.
        poses: (n, 7) rows x, y, z in metres, qx, qy, qz, qw: `X_fixed_frame`.
        rows: The row of each frame.
        elsewhere: Roots of trees that are not connected to the fixed frame, and how many frames
            each of these trees has.
    """

    names: list[str]
    poses: NDArray[np.float64]
    rows: Mapping[str, int]
    elsewhere: dict[str, int]

    def seen_from(self, fixed: str) -> Placement:
        """Return the same picture with another fixed frame, which is one of the names."""
        X_fixed_now = Transform.from_pose(self.poses[self.rows[fixed]]).inverse()
        return replace(self, poses=X_fixed_now.apply_poses(self.poses))


NOTHING = Placement([], np.empty((0, 7)), {}, {})


def place(lookups: Lookups, links: Mapping[str, ViewedLink], fixed: str) -> Placement:
    """Compute `X_fixed_frame` of each frame.

    Each link is looked up at its own time, as latest lookups do: one that has stopped holds nothing
    up but what hangs on it.

    Args:
        lookups: The tree.
        links: The links by name; a link whose parent is not among them is a root.
        fixed: The frame that stands still. If it is not there, nothing is placed.
    """
    levels, root_of = _levels(links)
    frames_of: dict[str, int] = {}
    for root in root_of.values():
        frames_of[root] = frames_of.get(root, 0) + 1
    here = root_of.get(fixed)
    elsewhere = {root: count for root, count in frames_of.items() if root != here}
    in_root = _in_root(lookups, [[x for x in level if root_of[x.name] == here] for level in levels])
    rows = {name: row for row, name in enumerate(in_root)}
    poses = np.array([*in_root.values()]).reshape(-1, 7)
    if fixed not in rows:
        return Placement([], np.empty((0, 7)), {}, elsewhere)
    return Placement([*rows], poses, rows, elsewhere).seen_from(fixed)


def roots_by_size(links: Mapping[str, ViewedLink]) -> list[str]:
    """Return the roots, that of the tree with the most frames first."""
    _, root_of = _levels(links)
    counts: dict[str, int] = {}
    for root in root_of.values():
        counts[root] = counts.get(root, 0) + 1
    return sorted(counts, key=lambda root: (-counts[root], root))


def _levels(links: Mapping[str, ViewedLink]) -> tuple[list[list[ViewedLink]], dict[str, str]]:
    """Return the links by their number of ancestors, and the root of each frame.

    Links that were read one after another may form a loop, if the tree changed meanwhile. Frames of
    a loop have no root and are left out.
    """
    children: dict[str, list[ViewedLink]] = {}
    level: list[ViewedLink] = []
    for link in links.values():
        if link.parent in links:
            children.setdefault(link.parent, []).append(link)  # type: ignore[arg-type]
        else:
            level.append(link)
    root_of = {link.name: link.name for link in level}
    levels = []
    while level:
        levels.append(level)
        level = [child for link in level for child in children.get(link.name, ())]
        for link in level:
            assert link.parent is not None
            root_of[link.name] = root_of[link.parent]
    return levels, root_of


def _in_root(lookups: Lookups, levels: list[list[ViewedLink]]) -> dict[str, NDArray[np.float64]]:
    """Return `X_root_frame` of each frame, parents first, without those that have no data."""
    identity = np.array([0.0, 0, 0, 0, 0, 0, 1])
    if not levels:
        return {}
    found = {link.name: identity for link in levels[0]}
    moving = [link for level in levels[1:] for link in level if link.sample_ns is not None]
    if not moving:
        return found
    # One call for all: a call costs as much as 20 lookups.
    answers = lookups.lookup_transforms(
        [str(link.parent) for link in moving],
        [link.name for link in moving],
        np.array([link.sample_ns or 0 for link in moving]),
    )
    X_parent_child = {
        link.name: row for link, row in zip(moving, answers.poses, strict=True) if row[6] == row[6]
    }
    for level in levels[1:]:
        rows = [x for x in level if x.name in X_parent_child and x.parent in found]
        if rows:
            parents = array_of(np.array([found[str(link.parent)] for link in rows]))
            links = array_of(np.array([X_parent_child[link.name] for link in rows]))
            composed = (parents @ links).poses
            found.update((link.name, pose) for link, pose in zip(rows, composed, strict=True))
    return found


def array_of(poses: NDArray[np.float64]) -> TransformArray:
    """Return pose rows (n, 7) as transforms, all with the stamp 0."""
    n = len(poses)
    return TransformArray(np.zeros(n, np.uint8), np.zeros(n, np.int64), poses)
