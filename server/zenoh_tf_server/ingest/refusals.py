"""Refused transforms and dropped puts, counted per authority and reason, with the last refusal.

Thread safety: all methods.
Invariant: what is kept is bounded. Of the authorities that had a message accepted, as many are
remembered as a tree knows; of the others only those that were refused last.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from zenoh_tf.bounded_map import BoundedMap

from ..limits import Limits

#: As many as a tree knows authorities (`Options::max_authorities` of the core).
_MAX_ACCEPTED: Final = 4096
#: A reason may quote names; longer ones are cut off.
_MAX_REASON: Final = 500


@dataclass(slots=True)
class _ByReason:
    by_reason: Counter[str] = field(default_factory=Counter)  # transforms
    dropped_puts: int = 0
    last_reason: str | None = None


class Refusals:
    def __init__(self, limits: Limits) -> None:
        self._lock = threading.Lock()
        self._by_reason = Counter[str]()  # of all authorities
        # Both: least recently refused, or first accepted, first.
        self.accepted = BoundedMap[str, _ByReason](_MAX_ACCEPTED)
        self._never_accepted = BoundedMap[str, _ByReason](limits.refused_authorities)

    def accept(self, authority: str) -> None:
        """Record that a message of `authority` was accepted."""
        if authority in self.accepted or not authority:
            return
        with self._lock:
            entry = self._never_accepted.pop(authority, None)
            self.accepted[authority] = entry or _ByReason()

    def refuse(self, authority: str, by_reason: Mapping[str, int], reason: str) -> None:
        """Count refused transforms of `authority`, and remember why.

        Args:
            authority: Their sender.
            by_reason: How many were refused for each reason (`zenoh_tf.admission`).
            reason: What was wrong with them, for people.
        """
        with self._lock:
            entry = self._entry(authority)
            entry.by_reason.update(by_reason)
            entry.last_reason = reason[:_MAX_REASON]
            self._by_reason.update(by_reason)

    def counters(self) -> dict[str, int]:
        """Counters for `stats`: refused transforms of all authorities, by reason."""
        with self._lock:
            return {f"refused/{reason}": count for reason, count in self._by_reason.items()}

    def drop(self, authority: str, puts: int) -> None:
        """Count puts of `authority` that were dropped because its queue was full."""
        with self._lock:
            self._entry(authority).dropped_puts += puts

    def forget_reasons(self) -> None:
        """Forget why transforms were refused, as the tree was reset: the reasons name frames that
        are gone. The counts stay: metrics have them."""
        with self._lock:
            for entries in (self.accepted, self._never_accepted):
                for entry in entries.values():
                    entry.last_reason = None

    def add_to(self, records: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The tree's authority records with what was refused, and records of the others."""
        with self._lock:
            refused = {
                name: _fields(entry)
                for entries in (self.accepted, self._never_accepted)
                for name, entry in entries.items()
                if entry.by_reason or entry.dropped_puts
            }
        nothing = _fields(_ByReason())
        merged = [{**record, **refused.pop(record["name"], nothing)} for record in records]
        of_tree = ("frames", "commits", "stored", "dropped", "rewritten", "conflicts")
        empty = dict.fromkeys(of_tree, 0)
        merged += [{"name": name, **empty, **fields} for name, fields in refused.items()]
        return merged

    def _entry(self, authority: str) -> _ByReason:
        """The entry of an authority, which becomes the one refused last."""
        entry = self.accepted.get(authority)
        if entry is not None:
            self.accepted.move_to_end(authority)
            return entry
        entry = self._never_accepted[authority] = self._never_accepted.get(authority) or _ByReason()
        return entry


def _fields(entry: _ByReason) -> dict[str, Any]:
    return {
        "refused": entry.by_reason.total(),
        "refused_by_reason": dict(entry.by_reason),
        "last_refusal": entry.last_reason,
        "dropped_by_queue": entry.dropped_puts,
    }
