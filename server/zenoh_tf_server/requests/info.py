"""What the tree holds and how its frames move: the `info` requests, except `hello`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Final

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import Budget
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.gap_limit import NO_GAPS, NO_LIMIT
from zenoh_tf.text import quoted

from ..ingest.clock_offsets import ClockOffsets
from ..ingest.refusals import Refusals
from ..limits import Limits
from .estimates import EstimateRequests
from .surroundings import Surroundings

#: Trees of more frames are not counted again for each `stats` and `authorities`.
_LARGE_TREE: Final = 100_000
#: How long the counts of a large tree are used.
_COUNTS_AGE_S: Final = 1.0
#: What a record of an authority or a client costs, as a multiple of a name's.
_RECORD: Final = 20
#: What a frame of a chain costs, for which it is also looked up.
_CHAINED: Final = 4
#: A name of so many bytes counts twice, one of twice as many three times.
_LONG_NAME: Final = 32


class _Counted:
    """The latest result of a scan of all frames."""

    def __init__(self, scan: Callable[[], Any]) -> None:
        self._scan = scan
        self._lock = threading.Lock()
        self._value: Any = None
        self._until_s = 0.0

    def value(self, frames: int) -> Any:
        """The result of a new scan, or for a large tree of one in the last second."""
        if frames <= _LARGE_TREE:
            return self._scan()
        with self._lock:
            if time.monotonic() > self._until_s:
                self._value = self._scan()
                self._until_s = time.monotonic() + _COUNTS_AGE_S
            return self._value


class InfoRequests:
    """Answers `info` requests from a tree. Thread safety: all methods."""

    def __init__(
        self,
        tree: TransformTree,
        limits: Limits,
        refusals: Refusals,
        clocks: ClockOffsets,
        counters: Callable[[], dict[str, int]],
        around: Surroundings,
    ) -> None:
        """`counters`: the server's own counters, added to the tree's in `stats`."""
        self._tree = tree
        self._name_bytes = limits.name_bytes
        self._estimates = EstimateRequests(tree, limits)
        self._refusals = refusals
        self._clocks = clocks
        self._counters = counters
        self._around = around
        self._stats = _Counted(tree.stats)
        self._authorities = _Counted(tree._authority_records)

    def reply(self, message: wire.Message, budget: Budget) -> wire.Message:
        """The fields of the reply. Raises TransformException."""
        what = wire.text(message, "what")
        if what == "frames":
            return self._frames(message, budget)
        return {"value": self._value(what, message, budget)}

    def _value(self, what: str, message: wire.Message, budget: Budget) -> Any:
        tree = self._tree
        if what == "frame":
            return tree._frame_record(self._frame(message, "frame"))
        if what == "ancestors":
            return self._ancestors(message, budget)
        if what == "authorities":
            return self._authority_records(budget)
        if what == "clients":
            return self._client_records(budget)
        if what == "parent":
            return tree.parent(self._frame(message, "frame"), _stamp(message))
        if what == "chain":
            return self._chain(message, budget)
        if what == "velocity":
            return self._velocity(message, budget)
        if what == "estimate":
            return self._estimates.one(message, budget)
        if what == "estimates":
            return self._estimates.rows(message, budget)
        if what == "stats":
            return self._stats_of(budget)
        raise InvalidArgumentException(f"unknown info request {quoted(what)}", field="what")

    def _frames(self, message: wire.Message, budget: Budget) -> wire.Message:
        """All names, or with `limit` a page of them and where the next one starts."""
        after = wire.integer(message, "after", 0, low=0)
        most = wire.integer(message, "limit", 0, low=0)
        left = budget.listed_left
        names, following = self._tree._frames_page(after, min(most or left, left), not most, budget)
        if following is None:
            budget.take_listed(len(names) + sum(map(len, names)) // _LONG_NAME)
            return {"value": names}
        if not most or not names:
            budget.take_listed(left)  # what was listed in vain
            budget.take_listed(1)
        budget.take_listed(min(left, len(names) + sum(map(len, names)) // _LONG_NAME))
        return {"value": names, "next": following}

    def authorities(self) -> list[dict[str, Any]]:
        """What is known of each authority: the fields of `zenoh_tf.AuthorityInfo`."""
        return self._merged(self._tree._authority_records())

    def _merged(self, records: list[dict[str, Any]]) -> list[dict[str, Any]]:
        merged = self._clocks.add_to(self._refusals.add_to(records))
        lost = self._around.lost_robots()
        for record in merged if lost else ():
            robot, colon, _ = record["name"].partition(":")
            if colon and robot in lost:
                record["mirror_lost_s"] = lost[robot]
        return merged

    def _authority_records(self, budget: Budget) -> Any:
        frames = self._tree._frame_count()
        budget.take_listed(1)
        _charge(budget, frames)
        records = self._merged(self._authorities.value(frames))
        _charge(budget, len(records) * _RECORD)
        return records

    def _client_records(self, budget: Budget) -> list[dict[str, Any]]:
        budget.take_listed(1)
        addresses = self._around.addresses()
        records = self._clocks.client_records()
        _charge(budget, len(records) * _RECORD)
        return [{**record, "address": addresses.get(record["client"])} for record in records]

    def _stats_of(self, budget: Budget) -> wire.Message:
        frames = self._tree._frame_count()
        budget.take_listed(1)
        _charge(budget, frames)
        counts: dict[str, int] = self._stats.value(frames)
        return wire.stats_value(counts | self._counters())

    def _chain(self, message: wire.Message, budget: Budget) -> list[str]:
        target, source = self._frame(message, "target"), self._frame(message, "source")
        budget.take_listed(1)
        names = self._tree.chain(target, source, _stamp(message))
        _charge(budget, len(names) * _CHAINED)
        return names

    def _ancestors(self, message: wire.Message, budget: Budget) -> list[dict[str, Any]]:
        target, source = self._frame(message, "target"), self._frame(message, "source")
        budget.take_links(self._tree._links((target, source)))
        budget.take_listed(1)
        records: list[dict[str, Any]] = self._tree._ancestor_records(
            target, source, _stamp(message)
        )
        _charge(budget, len(records) * _RECORD)
        return records

    def _velocity(self, message: wire.Message, budget: Budget) -> dict[str, Any]:
        tracking = self._frame(message, "tracking_frame")
        observation = self._frame(message, "observation_frame")
        reference = self._optional_frame(message, "reference_frame")
        point_frame = self._optional_frame(message, "reference_point_frame")
        named = [tracking, observation, reference or observation, point_frame or tracking]
        budget.take_links(2 * self._tree._links(named))
        return self._tree._velocity_record(
            tracking,
            observation,
            _stamp(message),
            wire.integer(message, "averaging_interval_ns", low=1),
            reference,
            wire.column(message, "reference_point", wire.F64, 3),
            point_frame,
            wire.integer(message, "max_gap_ns", NO_LIMIT, low=NO_GAPS),
        )

    def _frame(self, message: wire.Message, field: str) -> str:
        """A frame's name; LimitExceeded if it is too long for any frame."""
        return wire.name(message, field, self._name_bytes)

    def _optional_frame(self, message: wire.Message, field: str) -> str | None:
        return self._frame(message, field) if field in message else None


def _charge(budget: Budget, n: int) -> None:
    """Charge `n` listed names or as many as are left. So the first such request of a message is
    always answered, and the next one is refused."""
    budget.take_listed(min(n, budget.listed_left))


def _stamp(message: wire.Message) -> int | None:
    return wire.integer(message, "stamp_ns") if "stamp_ns" in message else None
