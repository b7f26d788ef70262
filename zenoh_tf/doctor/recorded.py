"""Facts for the doctor from the messages of a recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Final

import numpy as np

from zenoh_tf.doctor.facts import LinkFacts, TreeFacts
from zenoh_tf.doctor.observation import Observation
from zenoh_tf.errors import InvalidArgumentException, LimitExceeded
from zenoh_tf.tree import TransformTree

from .._core import TransformRows

#: Seconds that the tree keeps: as a server by default.
_CACHE_S: Final = 10.0
#: A tree refuses a quaternion whose squared norm is farther from 1.
_REFUSED: Final = 0.01


class RecordedFacts:
    """Gathers facts from messages in the order of their log. Its memory does not grow with them.

    The topics take the place of the authorities, as a recording does not name the publishers.
    """

    def __init__(self) -> None:
        self._tree = TransformTree(cache_time_s=_CACHE_S)
        self._observation = Observation()
        self._refused: Counter[str] = Counter()
        self._last_refusal: dict[str, str] = {}

    def add(self, log_ns: int, topic: str, static: bool, rows: TransformRows) -> None:
        """Add a message.

        Args:
            log_ns: When it was recorded, nanoseconds.
            topic: Where it was sent.
            static: Its links hold at all times.
            rows: Its transforms, with quaternions as received.
        """
        norms = np.linalg.norm(rows.pose[:, 3:], axis=1)
        self._observation.came(log_ns)
        for row, (parent, child) in enumerate(
            zip(rows.parent.tolist(), rows.child.tolist(), strict=True)
        ):
            if not (np.isfinite(rows.pose[row]).all() and abs(norms[row] ** 2 - 1.0) < _REFUSED):
                continue
            pose = rows.pose[row].copy()
            pose[3:] /= norms[row]
            names, stamp_ns = rows.names, int(rows.stamp[row])
            seen = self._observation.add(
                log_ns, names[child], names[parent], stamp_ns, pose, topic, static=static
            )
            seen.norm_error = max(seen.norm_error, abs(float(norms[row]) - 1.0))
        self._commit(topic, static, rows)

    def facts(self) -> TreeFacts:
        """Return the facts about all messages so far."""
        seen = self._observation.seen()
        links = [
            LinkFacts(self._tree.frame(name), seen=seen.get(name)) for name in self._tree.frames()
        ]
        authorities = [
            replace(
                authority,
                refused=self._refused[authority.name],
                last_refusal=self._last_refusal.get(authority.name),
            )
            for authority in self._tree.authorities()
        ]
        last_ns = self._observation.last_ns
        observed_s = (last_ns - (self._observation.first_ns or 0)) / 1e9
        return TreeFacts(links, last_ns, observed_s, authorities, is_complete=True)

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
