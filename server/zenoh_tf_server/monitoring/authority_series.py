"""Which authorities have series of their own, and the sum of all others.

Prometheus keeps a series for every value of a label, and anyone may publish under any name. So a
bounded number of authorities has series, and a counter of the rest is one sum that never falls.

Thread safety: none; the collector's lock guards it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from zenoh_tf.introspection.metric_table import FROM_AUTHORITIES, NOT_SUMMED
from zenoh_tf.text import cut, printable

OTHER: Final = "(other)"
_MAX_LABEL_CHARS: Final = 100

Counts = dict[str, float]


class AuthoritySeries:
    """Turns the tree's authority records into values by label."""

    def __init__(self, max_authorities: int) -> None:
        self._max = max_authorities
        self._own: set[str] = set()  # authorities with series of their own
        self._seen: dict[str, Counts] = {}  # the others, with their last values
        self._other: Counts = {}  # sums of the others' counters

    def values(self, records: Sequence[Mapping[str, Any]]) -> dict[str, Counts]:
        """Values by label and field of the record. An authority keeps its series for as long as
        it has a record."""
        by_name = {record["name"]: _counts(record) for record in records}
        self._own &= by_name.keys()
        for name in by_name:
            if len(self._own) == self._max:
                break
            if name not in self._seen:  # a change would count twice what it has in the sum
                self._own.add(name)
        series: dict[str, Counts] = {}
        others: dict[str, Counts] = {}
        for name, counts in by_name.items():
            if name in self._own:
                label = cut(printable(name), _MAX_LABEL_CHARS)
                _add(series.setdefault(label, {}), counts)
            else:
                others[name] = counts
        if others or self._other:
            _add(series.setdefault(OTHER, {}), self._sum_of(others))
        return series

    def _sum_of(self, others: dict[str, Counts]) -> Counts:
        gauges: Counts = {}
        for name, counts in others.items():
            before = self._seen.get(name, {})
            for field, value in counts.items():
                if FROM_AUTHORITIES[field].kind == "counter":
                    grown = value - before.get(field, 0.0)
                    # Less than before: it was freed, and its name came back.
                    _add(self._other, {field: grown if grown >= 0 else value})
                elif field not in NOT_SUMMED:
                    _add(gauges, {field: value})
        self._seen = others
        return {**self._other, **gauges}


def _counts(record: Mapping[str, Any]) -> Counts:
    return {
        field: float(record[field])
        for field in FROM_AUTHORITIES
        if isinstance(record.get(field), (int, float))
    }


def _add(to: Counts, counts: Mapping[str, float]) -> None:
    for field, value in counts.items():
        to[field] = to.get(field, 0.0) + value
