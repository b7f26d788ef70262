"""Poses with their errors: the `info` requests `estimate` and `estimates`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import LimitExceeded

from ..limits import Limits

if TYPE_CHECKING:
    from zenoh_tf._core import Budget

#: What the backtests of a pair of frames cost, as a multiple of a lookup, if none are kept: those
#: of levels up to 0.99, and of higher ones, which need five times as many.
_BACKTESTS: Final = 5_000
_MANY_BACKTESTS: Final = 25_000
_FEW_LEVEL: Final = 0.99
#: What an estimate from kept backtests costs.
_ESTIMATE: Final = 50
#: To a client whose message costs too much.
_ADVICE: Final = (
    f"an estimate counts as {_ESTIMATE} lookups, and as {_BACKTESTS:,} more for its pair of frames "
    f"({_MANY_BACKTESTS:,} at levels above {_FEW_LEVEL}): ask for many estimates of few pairs by "
    "`estimate_transforms`, where each pair counts once, and send those of many pairs in several "
    "messages"
)


class EstimateRequests:
    """Estimates poses from a tree, by this machine's clock. Thread safety: all methods."""

    def __init__(self, tree: TransformTree, limits: Limits) -> None:
        self._tree = tree
        self._limits = limits

    def one(self, message: wire.Message, budget: Budget) -> dict[str, Any]:
        """The fields of one `zenoh_tf.Estimate`."""
        name_bytes = self._limits.name_bytes
        target = wire.name(message, "target", name_bytes)
        source = wire.name(message, "source", name_bytes)
        level = wire.number(message, "level")
        self._take(budget, _ESTIMATE + _backtests(level), [(target, source)])
        return self._tree._estimate_record(
            target,
            source,
            wire.integer(message, "stamp_ns") if "stamp_ns" in message else None,
            time.time_ns(),
            level,
            wire.integer(message, "max_by_ns", low=0),
            wire.number(message, "radius_m"),
        )

    def rows(self, message: wire.Message, budget: Budget) -> wire.Message:
        """The columns of many estimates, each at an instant of its own."""
        ask = wire.parse_estimates(message)
        self._limits.check("rows", ask.target.size)
        self._limits.check_names(len(ask.names))
        budget.take_reply(wire.ESTIMATE_BYTES * ask.target.size)
        pairs = [
            (ask.names[target], ask.names[source])
            for target, source in np.column_stack((ask.target, ask.source)).tolist()
        ]
        self._take(budget, _ESTIMATE, pairs)
        self._take(budget, _backtests(ask.level), [*set(pairs)])
        columns = self._tree._estimate_columns(
            [target for target, _ in pairs],
            [source for _, source in pairs],
            ask.stamp,
            time.time_ns(),
            ask.level,
            ask.max_by_ns,
            ask.radius_m,
        )
        return wire.estimates_value(columns)

    def _take(self, budget: Budget, times: int, pairs: Sequence[tuple[str, str]]) -> None:
        """Take so many lookups of each pair from what the message may cost."""
        links = self._tree._links([name for pair in pairs for name in pair])
        try:
            budget.take_links(times * (links + len(pairs)))
        except LimitExceeded as error:
            raise LimitExceeded(f"{error}; {_ADVICE}", **error.facts) from None


def _backtests(level: float) -> int:
    return _BACKTESTS if level <= _FEW_LEVEL else _MANY_BACKTESTS
