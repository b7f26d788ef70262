"""Poses with their errors: the `info` requests `estimate` and `estimates`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import TransformTree, wire

from ..limits import Limits

if TYPE_CHECKING:
    from zenoh_tf._core import Budget

#: What an estimate costs at most, as a multiple of a lookup: it backtests its question on 200 past
#: instants, with a prediction and a lookup at each, if no residuals are kept from before.
_LOOKUPS: Final = 400


class Estimates:
    """Estimates poses from a tree, by this machine's clock. Thread safety: all methods."""

    def __init__(self, tree: TransformTree, limits: Limits) -> None:
        self._tree = tree
        self._limits = limits

    def one(self, message: wire.Message, budget: Budget) -> dict[str, Any]:
        """The fields of one `zenoh_tf.Estimate`."""
        name_bytes = self._limits.name_bytes
        target = wire.name(message, "target", name_bytes)
        source = wire.name(message, "source", name_bytes)
        budget.take_links(_LOOKUPS * (self._tree._links((target, source)) + 1))
        return self._tree._estimate_record(
            target,
            source,
            wire.integer(message, "stamp_ns") if "stamp_ns" in message else None,
            time.time_ns(),
            wire.number(message, "level"),
            wire.integer(message, "max_by_ns", low=0),
            wire.number(message, "radius_m"),
        )

    def rows(self, message: wire.Message, budget: Budget) -> wire.Message:
        """The columns of many estimates, each at an instant of its own."""
        ask = wire.parse_estimates(message)
        self._limits.check("rows", ask.target.size)
        self._limits.check_names(len(ask.names))
        budget.take_reply(wire.ESTIMATE_BYTES * ask.target.size)
        targets = [ask.names[index] for index in ask.target.tolist()]
        sources = [ask.names[index] for index in ask.source.tolist()]
        links = self._tree._links([*targets, *sources])
        budget.take_links(_LOOKUPS * (links + len(targets)))
        found = self._tree.estimate_transforms(
            targets,
            sources,
            ask.stamp,
            level=ask.level,
            max_by_s=ask.max_by_ns * 1e-9,
            radius_m=ask.radius_m,
        )
        return wire.estimates_value(found.columns())
