"""Facts for the doctor from the messages of a recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from zenoh_tf import admission
from zenoh_tf._core import TransformRows
from zenoh_tf.tree import TransformTree
from zenoh_tf_tools.doctor.facts import LinkFacts, TreeFacts
from zenoh_tf_tools.doctor.observation import Observation

#: Seconds that the tree keeps: as a server by default.
_CACHE_S: Final = 10.0
#: A tree refuses a quaternion whose squared norm is farther from 1.
_REFUSED: Final = 0.01


@dataclass(slots=True)
class _Static:
    """A static message without its stamps, which say nothing."""

    names: list[str]
    parent: bytes
    child: bytes
    pose: bytes
    children: set[str] = field(default_factory=set, compare=False)


class RecordedFacts:
    """Gathers facts from messages in the order of their log. Its memory does not grow with them.

    The topics take the place of the authorities, as a recording does not name the publishers.
    """

    def __init__(self) -> None:
        self._tree = TransformTree(cache_time_s=_CACHE_S)
        self._observation = Observation()
        self._refused: Counter[str] = Counter()
        self._last_refusal: dict[str, str] = {}
        self._statics: dict[str, _Static] = {}  # by topic
        self._writers: dict[str, str] = {}  # of each child frame, the topic that wrote it last

    def add(self, log_ns: int, topic: str, static: bool, rows: TransformRows) -> None:
        """Add a message.

        Args:
            log_ns: When it was recorded, nanoseconds.
            topic: Where it was sent.
            static: Its links hold at all times.
            rows: Its transforms, with quaternions as received.
        """
        self._observation.came(log_ns)
        if static and self._says_nothing_new(topic, rows):
            return
        names, poses = rows.names, rows.pose.copy()
        norms = np.linalg.norm(poses[:, 3:], axis=1)
        valid = np.isfinite(poses).all(axis=1) & (np.abs(norms**2 - 1.0) < _REFUSED)
        with np.errstate(invalid="ignore", divide="ignore"):
            poses[:, 3:] /= norms[:, None]
        columns = (rows.parent, rows.child, rows.stamp, norms, valid)
        for row, (parent, child, stamp_ns, norm, is_valid) in enumerate(
            zip(*(column.tolist() for column in columns), strict=True)
        ):
            self._writers[names[child]] = topic
            if not is_valid:
                continue
            seen = self._observation.add(
                log_ns, names[child], names[parent], stamp_ns, poses[row], topic, static=static
            )
            seen.norm_error = max(seen.norm_error, abs(norm - 1.0))
        refused = self._refused[topic]
        self._commit(topic, static, rows)
        if static and self._refused[topic] > refused:
            del self._statics[topic]  # each is counted

    def _says_nothing_new(self, topic: str, rows: TransformRows) -> bool:
        """Whether a static message repeats the one before of its topic, and nobody else has written
        its links since."""
        known = self._statics.get(topic)
        found = _Static(
            rows.names, rows.parent.tobytes(), rows.child.tobytes(), rows.pose.tobytes()
        )
        if known == found and all(self._writers.get(name) == topic for name in known.children):
            return True
        found.children = {found.names[child] for child in rows.child.tolist()}
        self._statics[topic] = found
        return False

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
        stored = self._tree._commit_rows(
            rows, authority=topic, static=static, drop_old=True, drop_bad=True
        )
        refused = admission.refused(self._tree, rows, stored)
        if refused is not None:
            self._refused[topic] += refused.total
            self._last_refusal[topic] = refused.reason
