"""Refused transforms, counted per authority, with the reason of the last refusal.

Thread safety: all methods.
Invariant: what is kept is bounded. Authorities of the tree are bounded by the tree; of the other
authorities, none of whose messages was ever accepted, only those refused last are remembered.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, Final

from .limits import Limits

#: As many as a tree knows authorities (`Options::max_authorities` of the core).
_MAX_ACCEPTED: Final = 4096
#: A reason may quote names; longer ones are cut off.
_MAX_REASON: Final = 500


@dataclass(slots=True)
class _Refused:
    transforms: int = 0
    last_reason: str | None = None


class Refusals:
    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._accepted: dict[str, _Refused] = {}
        self._never_accepted: OrderedDict[str, _Refused] = OrderedDict()  # oldest refusal first

    def accept(self, authority: str) -> None:
        """Note that a message of `authority` was accepted: it is never forgotten then."""
        if authority in self._accepted or not authority:
            return
        with self._lock:
            if len(self._accepted) < _MAX_ACCEPTED:
                entry = self._never_accepted.pop(authority, None)
                self._accepted[authority] = entry or _Refused()

    def refuse(self, authority: str, transforms: int, reason: str) -> None:
        """Count refused transforms of `authority`, and remember why."""
        with self._lock:
            entry = self._accepted.get(authority)
            if entry is None:
                entry = self._never_accepted.setdefault(authority, _Refused())
                self._never_accepted.move_to_end(authority)
                if len(self._never_accepted) > self._limits.refused_authorities:
                    self._never_accepted.popitem(last=False)
            entry.transforms += transforms
            entry.last_reason = reason[:_MAX_REASON]

    def add_to(self, records: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The tree's authority records with what was refused, and records of the others."""
        with self._lock:
            refused = {
                name: (entry.transforms, entry.last_reason)
                for entries in (self._accepted, self._never_accepted)
                for name, entry in entries.items()
                if entry.transforms
            }
        merged = [_with(record, *refused.pop(record["name"], (0, None))) for record in records]
        empty = {
            "frames": 0,
            "commits": 0,
            "stored": 0,
            "dropped": 0,
            "rewritten": 0,
            "conflicts": 0,
        }
        merged += [_with({"name": name, **empty}, *entry) for name, entry in refused.items()]
        return merged


def _with(record: dict[str, Any], transforms: int, reason: str | None) -> dict[str, Any]:
    return {**record, "refused": transforms, "last_refusal": reason}
