"""The tree that chaos transactions read and write: every pose says which versions it was made of.

    root - epoch - link0 - link1 - link2
                        \\ link3 - link4

The translation of a link is its version, moved to a place of 26 binary digits that no other link
uses; rotations are identities. So the pose of a chain is exact in doubles and says the version of
every link in it. The link to `epoch` says which server process holds the tree: each starts empty.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from zenoh_tf import StampedTransform, Transform

_DIGITS = 26
LAST_VERSION = (1 << _DIGITS) - 1
PARENTS = ("epoch", "link0", "link1", "link0", "link3")
LINKS = len(PARENTS)
#: By the link at the end of a chain from the root: the links in it.
CHAINS = {0: (0,), 1: (0, 1), 2: (0, 1, 2), 3: (0, 3), 4: (0, 3, 4)}
#: Where a link's version stands: the axis, and whether it is moved up.
_PLACES = ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0))


class Seen(NamedTuple):
    """What one read saw: the server's epoch, and the version of each link of a chain."""

    epoch: int
    versions: dict[int, int]


def _pose(axis: int, moved: int, version: int) -> Transform:
    xyz = [0.0, 0.0, 0.0]
    xyz[axis] = float(version << (_DIGITS * moved))
    return Transform((xyz[0], xyz[1], xyz[2]))


def rows(links: Iterable[int], version: int) -> list[StampedTransform]:
    """The transforms that write a version to links. Stamps give the order of versions."""
    return [
        StampedTransform(PARENTS[link], f"link{link}", version, _pose(*_PLACES[link], version))
        for link in links
    ]


def first_rows(epoch: int) -> list[StampedTransform]:
    """The transforms that make the tree of a new server."""
    return [StampedTransform("root", "epoch", 1, _pose(2, 1, epoch)), *rows(range(LINKS), 1)]


def decode(end: int, transform: Transform) -> Seen:
    """The versions in a pose of `link{end}` in the root.

    Raises:
        ValueError: No commits can have made this pose.
    """
    words = [int(value) for value in transform.translation]
    if any(word != value for word, value in zip(words, transform.translation, strict=True)):
        raise ValueError(f"not a sum of versions: {transform}")
    versions = {}
    for link in range(LINKS):
        axis, moved = _PLACES[link]
        version = words[axis] >> (_DIGITS * moved) & LAST_VERSION
        if (version > 0) != (link in CHAINS[end]):
            raise ValueError(f"link {link} has version {version} in a pose of link {end}")
        if version:
            versions[link] = version
    return Seen(words[2] >> _DIGITS, versions)
