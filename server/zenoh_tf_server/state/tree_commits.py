"""Commits a transaction's columns to the tree, and finds which static links it leaves there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformTree, wire

from .file import StoredLink

#: What became of each row: (n,) uint8.
Stores = NDArray[np.uint8]


def apply(tree: TransformTree, commit: wire.Commit) -> Stores:
    """Commit a transaction to the tree: (n,) uint8, 1 stored, 0 dropped as too old."""
    return tree._commit_rows(
        commit.rows,
        authority=commit.authority,
        static=commit.static,
        drop_old=commit.drop_old,
        read_names=commit.read_names,
        read_versions=commit.read_versions,
        expires_ns=commit.expires_ns,
    )


def last_links(commit: wire.Commit, *, by_call: bool) -> dict[str, StoredLink]:
    """The link of each child as the tree has it after a static commit: of several rows of one child
    it applies the one with the highest stamp last, and the last of those."""
    links: dict[str, StoredLink] = {}
    names = commit.rows.names
    columns = zip(
        commit.rows.parent.tolist(),
        commit.rows.child.tolist(),
        commit.rows.stamp.tolist(),
        commit.rows.pose.tolist(),
        strict=True,
    )
    for parent, child, stamp_ns, pose in columns:
        before = links.get(names[child])
        if before is None or stamp_ns >= before.stamp_ns:
            links[names[child]] = StoredLink(
                names[parent], stamp_ns, tuple(pose), commit.authority, by_call
            )
    return links
