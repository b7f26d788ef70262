"""The lookups of mirrors: those of the tree that a mirror has now.

While there is one, none of the methods here is called: the mirror has the tree's own methods as
attributes, because a call of Python's in between would cost half as much as a lookup.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Concatenate, Final, ParamSpec, TypeVar

from zenoh_tf import Estimate, TransformTree
from zenoh_tf._zenoh.calls import raise_if_forked
from zenoh_tf.errors import ServerUnavailable
from zenoh_tf.estimate import TreeEstimates

if TYPE_CHECKING:
    from zenoh_tf._core_stubs.estimates import EstimateColumns

P = ParamSpec("P")
T = TypeVar("T")


def _of_tree(
    method: Callable[Concatenate[TransformTree, P], T],
) -> Callable[Concatenate[MirrorReads, P], T]:
    """The same method, of a mirror's tree."""

    @functools.wraps(method)
    def read(mirror: MirrorReads, /, *arguments: P.args, **named: P.kwargs) -> T:
        found: T = getattr(mirror._tree, method.__name__)(*arguments, **named)
        return found

    return read


class MirrorReads:
    """A base of `Mirror`, which chooses the tree."""

    _current: TransformTree | None = None  # None: closed, or forked

    @property
    def _tree(self) -> TransformTree:
        """The tree. Raises ServerUnavailable if there is none."""
        tree = self._current
        if tree is None:
            raise_if_forked()
            raise ServerUnavailable("the mirror is closed")
        return tree

    lookup_transform = _of_tree(TransformTree.lookup_transform)
    lookup_transform_full = _of_tree(TransformTree.lookup_transform_full)
    can_transform = _of_tree(TransformTree.can_transform)
    latest_common_time = _of_tree(TransformTree.latest_common_time)
    lookup_transforms = _of_tree(TransformTree.lookup_transforms)
    sample = _of_tree(TransformTree.sample)
    deskew = _of_tree(TransformTree.deskew)
    lookup_velocity = _of_tree(TransformTree.lookup_velocity)
    frames = _of_tree(TransformTree.frames)
    frame = _of_tree(TransformTree.frame)
    parent = _of_tree(TransformTree.parent)
    chain = _of_tree(TransformTree.chain)
    estimate_transform = TreeEstimates.estimate_transform
    estimate_transforms = TreeEstimates.estimate_transforms

    def _estimate(self, *arguments: Any) -> Estimate:
        return self._tree._estimate(*arguments)

    def _estimate_columns(self, *arguments: Any) -> EstimateColumns:
        return self._tree._estimate_columns(*arguments)


#: The methods that a mirror has as attributes.
OF_TREE: Final = (
    *("lookup_transform", "lookup_transform_full", "can_transform", "latest_common_time"),
    *("lookup_transforms", "sample", "deskew", "lookup_velocity"),
    *("frames", "frame", "parent", "chain", "_estimate", "_estimate_columns"),
)
