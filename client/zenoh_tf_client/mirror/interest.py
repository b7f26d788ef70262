"""What a mirror of a part of the tree answers about the rest: an error that says so.

Mirrors of the whole tree have nothing to do with this module.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Final, ParamSpec, TypeVar, cast

from zenoh_tf import Explanation, TransformTree, wire
from zenoh_tf.errors import (
    ConnectivityException,
    InvalidArgumentException,
    LookupException,
    TransformException,
    must_be,
)
from zenoh_tf.text import quoted

from .reads import LATEST, PLAIN, WAITING

P = ParamSpec("P")
T = TypeVar("T")

#: Bounds of `max_rate_hz`.
_LOWEST_HZ: Final = 0.001
_HIGHEST_HZ: Final = 1000.0
#: How long the server gathers changes of the pairs' frames, if not said otherwise, and at most.
_DELAY_S: Final = 0.05
_LONGEST_DELAY_S: Final = 10.0
#: Errors that may be due to frames that the mirror has not.
_EXPLAINED: Final = (LookupException, ConnectivityException)


class OutsideInterest(LookupException):
    """A frame is not in a mirror, as it is on no path between the pairs that the mirror was made
    for. It may exist at the server, which can be asked by query. ``frame`` names it."""


def interest_of(
    pairs: Sequence[tuple[str, str]] | None, max_delay_s: float | None, max_rate_hz: float | None
) -> wire.Interest | None:
    """The interest of a mirror; None: everything, at once. Raises InvalidArgumentException."""
    if pairs is not None:
        _check_pairs(pairs)
    period_ns = 0
    if max_rate_hz is not None:
        rate = float(max_rate_hz)
        if not (math.isfinite(rate) and _LOWEST_HZ <= rate <= _HIGHEST_HZ):
            limits = f"from {_LOWEST_HZ:g} to {_HIGHEST_HZ:g}"
            raise must_be("max_rate_hz", limits, max_rate_hz)
        period_ns = round(1e9 / rate)
    if max_delay_s is not None and (pairs is None or period_ns):
        raise InvalidArgumentException(
            "max_delay_s is for a mirror of pairs without max_rate_hz", field="max_delay_s"
        )
    if pairs is None and not period_ns:
        return None
    delay_s = _DELAY_S if max_delay_s is None else float(max_delay_s)
    if not 0 <= delay_s <= _LONGEST_DELAY_S:
        raise must_be("max_delay_s", f"from 0 to {_LONGEST_DELAY_S:g}", max_delay_s)
    return wire.Interest.of(pairs or (), period_ns, 0 if period_ns else round(delay_s * 1e9))


def _check_pairs(pairs: Sequence[tuple[str, str]]) -> None:
    if isinstance(pairs, str) or not pairs:
        raise InvalidArgumentException(
            f"pairs must be a list of pairs of frames, not {pairs!r}; without it, the mirror has "
            "all frames",
            field="pairs",
        )
    for pair in pairs:
        if isinstance(pair, str) or len(pair) != 2:
            raise InvalidArgumentException(
                f"pairs must have two frames each, target and source, not {pair!r}", field="pairs"
            )
        for name in pair:
            if not isinstance(name, str) or not name or not _is_utf8(name):
                raise InvalidArgumentException(
                    f"pairs must have names of frames, not {name!r}", field="pairs"
                )


def _is_utf8(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


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
        for name in (*PLAIN, *WAITING, *LATEST):
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
