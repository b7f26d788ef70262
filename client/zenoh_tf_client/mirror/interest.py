"""What a mirror of a part of the tree answers about the rest: an error that says so.

Mirrors of the whole tree have nothing to do with this module.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Final, ParamSpec, TypeVar, cast

from zenoh_tf import Explanation, TransformTree, wire
from zenoh_tf.errors import (
    ConnectivityException,
    LookupException,
    TransformException,
)
from zenoh_tf.text import quoted

from .reads import OF_TREE

P = ParamSpec("P")
T = TypeVar("T")

#: The lookups that a mirror may ask the server for instead.
_LATEST: Final = (
    "lookup_latest_transform",
    "lookup_latest_transform_xact",
    "lookup_latest_transforms_xact",
)
#: Errors that may be due to frames that the mirror has not.
_EXPLAINED: Final = (LookupException, ConnectivityException)


class OutsideInterest(LookupException):
    """A frame is not in a mirror, as it is on no path between the pairs that the mirror was made
    for. It may exist at the server, which can be asked by query. ``frame`` names it."""


def explained(
    method: Callable[P, T], tree: TransformTree, interest: wire.Interest
) -> Callable[P, T]:
    """The same function, whose errors name frames that the mirror lacks."""

    @functools.wraps(method)
    def call(*arguments: P.args, **named: P.kwargs) -> T:
        try:
            return method(*arguments, **named)
        except _EXPLAINED as error:
            raise _explain(error, tree, interest) from None

    return call


def interested(tree: TransformTree, interest: wire.Interest) -> TransformTree:
    """The tree's lookups, whose errors name frames that the mirror lacks."""
    if not interest.pairs:  # it has all frames
        return tree
    return cast("TransformTree", _InterestedTree(tree, interest))


class _InterestedTree:
    def __init__(self, tree: TransformTree, interest: wire.Interest) -> None:
        for name in (*OF_TREE, *_LATEST):
            setattr(self, name, explained(getattr(tree, name), tree, interest))

        def explain(target: str, source: str, stamp_ns: int | None = None) -> Explanation:
            for name in (target, source):
                if _is_outside(name, {*tree.frames()}, interest):
                    raise _outside(name, {"frame": name})
            return tree.explain(target, source, stamp_ns)

        self.explain = explain


def _explain(
    error: TransformException, tree: TransformTree, interest: wire.Interest
) -> TransformException:
    if isinstance(error, LookupException):
        suspects = [error.frame, error.target_frame, error.source_frame]
    else:
        suspects = [error.target_root, error.source_root]
    present = {*tree.frames()}
    for name in suspects:
        if name is not None and _is_outside(name, present, interest):
            return _outside(name, error.facts | {"frame": name})
    return error


def _is_outside(name: str, present: set[str], interest: wire.Interest) -> bool:
    return name not in present and not any(name in pair for pair in interest.pairs)


def _outside(name: str, facts: dict[str, object]) -> OutsideInterest:
    return OutsideInterest(
        f"frame {quoted(name)} is not in this mirror: it is on no path between the pairs of frames "
        "that the mirror was made for; add a pair with it, or ask by query (TransformClient)",
        **facts,
    )
