"""What is new in a tree since the last picture: links and their poses, for viewers of others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_tf_tools.viewer.source import ViewedLink, ViewedTree

#: A link's pose, ``X_parent_child``, as (7,): x, y, z in metres, qx, qy, qz, qw.
Change = tuple[ViewedLink, NDArray[np.float64]]


class LinkChanges:
    """The links whose sample, parent or kind differs from what was taken last.

    Thread safety: none.
    """

    def __init__(self, source: ViewedTree) -> None:
        """Nothing is taken yet."""
        self._source = source
        self._taken: dict[str, tuple[object, ...]] = {}

    def forget(self) -> None:
        """All links are new again."""
        self._taken.clear()

    def take(self, links: Iterable[ViewedLink]) -> Iterator[Change]:
        """Yield the links that are new, with their poses; from now on they are not.

        Args:
            links: The links of one picture, all of them: what is missing is forgotten.
        """
        known = [x for x in links if x.parent is not None and x.sample_ns is not None]
        changed = [x for x in known if _key(x) != self._taken.get(x.name)]
        self._taken = {x.name: _key(x) for x in known}
        return self._look_up(changed)

    def _look_up(self, links: Sequence[ViewedLink]) -> Iterator[Change]:
        if not links:
            return
        answers = self._source.lookups.lookup_transforms(
            [str(x.parent) for x in links],
            [x.name for x in links],
            [x.sample_ns or 0 for x in links],
        )
        for link, pose, ok in zip(links, answers.poses, answers.ok, strict=True):
            if ok:  # a link may be gone since it was listed
                yield link, pose


def _key(link: ViewedLink) -> tuple[object, ...]:
    return link.parent, link.static, link.sample_ns
