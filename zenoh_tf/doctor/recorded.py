"""Facts for the doctor from the messages of a recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Final

import numpy as np

from zenoh_tf.doctor.facts import LinkFacts, TreeFacts
from zenoh_tf.errors import InvalidArgumentException, LimitExceeded
from zenoh_tf.tree import TransformTree

from .._core import TransformRows

#: Seconds that the tree keeps: as a server by default.
_CACHE_S: Final = 10.0


class RecordedFacts:
    """Gathers facts from messages in the order of their log. Its memory does not grow with them.

    The topics take the place of the authorities, as a recording does not name the publishers.
    """

    def __init__(self) -> None:
        self._tree = TransformTree(cache_time_s=_CACHE_S)
        self._newest: dict[str, int] = {}
        self._longest_ns: Counter[str] = Counter()
        self._received: Counter[str] = Counter()
        self._norm_error: dict[str, float] = {}
        self._refused: Counter[str] = Counter()
        self._last_refusal: dict[str, str] = {}
        self._first_ns: int | None = None
        self._last_ns = 0

    def add(self, log_ns: int, topic: str, static: bool, rows: TransformRows) -> None:
        """Add a message.

        Args:
            log_ns: When it was recorded, nanoseconds.
            topic: Where it was sent.
            static: Its links hold at all times.
            rows: Its transforms, with quaternions as received.
        """
        self._first_ns = log_ns if self._first_ns is None else self._first_ns
        self._last_ns = log_ns
        errors = np.abs(np.linalg.norm(rows.pose[:, 3:], axis=1) - 1.0)
        for row, child in enumerate(rows.child.tolist()):
            name = rows.names[child]
            self._received[name] += 1
            self._norm_error[name] = max(self._norm_error.get(name, 0.0), float(errors[row]))
            if not static:
                self._record_gap(name, int(rows.stamp[row]))
        self._commit(topic, static, rows)

    def facts(self) -> TreeFacts:
        """Return the facts about all messages so far."""
        links = [
            LinkFacts(
                self._tree.frame(name),
                longest_gap_s=self._longest_ns[name] / 1e9 or None,
                norm_error=self._norm_error.get(name),
                received=self._received[name],
            )
            for name in self._tree.frames()
        ]
        authorities = [
            replace(
                authority,
                refused=self._refused[authority.name],
                last_refusal=self._last_refusal.get(authority.name),
            )
            for authority in self._tree.authorities()
        ]
        observed_s = (self._last_ns - (self._first_ns or 0)) / 1e9
        return TreeFacts(links, self._last_ns, observed_s, authorities, is_complete=True)

    def _record_gap(self, frame: str, stamp_ns: int) -> None:
        newest = self._newest.get(frame)
        if newest is not None and stamp_ns <= newest:
            return
        self._newest[frame] = stamp_ns
        if newest is not None:
            self._longest_ns[frame] = max(self._longest_ns[frame], stamp_ns - newest)

    def _commit(self, topic: str, static: bool, rows: TransformRows) -> None:
        try:
            self._commit_rows(topic, static, rows)
        except (InvalidArgumentException, LimitExceeded):
            # One row makes the tree reject all of them.
            for row in range(len(rows)):
                try:
                    self._commit_rows(topic, static, rows[row : row + 1])
                except (InvalidArgumentException, LimitExceeded) as error:
                    self._refused[topic] += 1
                    self._last_refusal[topic] = str(error)

    def _commit_rows(self, topic: str, static: bool, rows: TransformRows) -> None:
        self._tree._commit_rows(rows, authority=topic, static=static, drop_old=True)
