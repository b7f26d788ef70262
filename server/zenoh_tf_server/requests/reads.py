"""Lookups that do not wait, from a message's columns to the reply's fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import TransformException

from ..limits import Limits

if TYPE_CHECKING:
    from zenoh_tf._core import Budget

#: Bytes of a row in a lookup's reply: status, stamp, newest stamp, pose and gap.
_ROW_BYTES: Final = 1 + 8 + 8 + 56 + 8


class LookupRequests:
    """Looks transforms up in a tree. Thread safety: all methods."""

    def __init__(self, tree: TransformTree, limits: Limits) -> None:
        self._tree = tree
        self._limits = limits

    def one(
        self, target: str, source: str, op: int, stamp_ns: int, budget: Budget
    ) -> wire.Message | None:
        """Fast path of a single lookup between other requests of a batch, without options: the
        reply's fields, or None if the lookup fails or is of another type. The general path then
        finds out why; it takes five times as long. A lookup that is a message of its own needs
        neither (`_core.reply_to_lookup`)."""
        tree = self._tree
        newest_ns = None
        try:
            budget.take_links(tree._links((target, source)) + 1)
            if op == wire.OP_AT and stamp_ns != wire.NO_STAMP:
                found = tree.lookup_transform(target, source, stamp_ns)
            elif op == wire.OP_COMMON:
                found = tree.lookup_transform(target, source)
            elif op == wire.OP_LATEST:
                found = latest = tree.lookup_latest_transform(target, source)
                newest_ns = latest.newest_stamp_ns
            elif op == wire.OP_LATEST_XACT:
                found = latest = tree.lookup_latest_transform_xact(target, source)
                newest_ns = latest.newest_stamp_ns
            else:
                return None
        except TransformException:
            return None
        return wire.one_answer(found.stamp_ns, newest_ns, found.transform.pose(), found.gap_ns)

    def rows(self, lookup: wire.Lookup, budget: Budget) -> wire.Message:
        """The fields of the reply to a lookup that does not wait."""
        self._limits.check_names(len(lookup.names))
        budget.take_reply(_ROW_BYTES * lookup.rows)
        rows = self._tree._read_rows(
            *lookup.columns,
            atomic=lookup.atomic,
            versions=lookup.versions,
            errors=lookup.errors,
            budget=budget,
            max_gap_ns=lookup.max_gap_ns,
        )
        return wire.lookup_reply(lookup, *rows)
