"""A recording as a tree, shown at any of its times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformTree
from zenoh_tf.recordings import MAX_MEMORY_BYTES, OPTIONS, Recording
from zenoh_tf.recordings.load import valid_commits
from zenoh_tf_tools.doctor.timing import PAUSE_PERIODS
from zenoh_tf_tools.viewer.source import Lookups, ViewedLink

#: The rate of a link is that of its samples in this long before the time.
_RATE_NS = 5 * 10**9
#: A pause of a link is at least so long.
_PAUSE_NS = 500_000_000


class RecordedSource:
    """A recording; what is shown at a time is what its samples say about that time."""

    def __init__(
        self, recording: Recording, on_messages: Callable[[int], None] | None = None
    ) -> None:
        """Read a recording.

        Args:
            recording: The recording, open.
            on_messages: Called with the number of messages read, now and then.

        Raises:
            RecordingError: It is damaged, or has no transforms.
            LimitExceeded: It has too many.
        """
        self._tree = TransformTree(**OPTIONS, max_memory_bytes=MAX_MEMORY_BYTES)
        #: The stamps of each dynamic link, sorted; its history has only the first and last.
        self._stamps_ns = _read(recording, self._tree, on_messages)
        self._names = self._tree.frames()
        self.range_ns = recording.range_ns or (0, 0)

    @property
    def lookups(self) -> Lookups:
        return self._tree

    def names(self) -> list[str]:
        return self._names

    def link(self, name: str, time_ns: int, *, past: bool = True) -> ViewedLink | None:
        frame = self._tree.frame(name)
        stamps_ns = self._stamps_ns.get(name)
        if frame.parent is None or frame.static or stamps_ns is None:
            return ViewedLink(
                name, frame.parent, frame.static, frame.newest_stamp_ns, None, None, frame.authority
            )
        sample_ns = int(min(max(time_ns, stamps_ns[0]), stamps_ns[-1]))
        # The samples up to the time, or the first one.
        known = max(1, int(np.searchsorted(stamps_ns, time_ns, "right")))
        since = int(np.searchsorted(stamps_ns, stamps_ns[known - 1] - _RATE_NS))
        span_ns = int(stamps_ns[known - 1] - stamps_ns[since])
        return ViewedLink(
            name,
            self._tree.parent(name, sample_ns),
            False,
            sample_ns,
            (time_ns - int(stamps_ns[known - 1])) / 1e9,
            (known - 1 - since) * 1e9 / span_ns if span_ns else None,
            frame.authority,
        )

    def now_ns(self, links: Sequence[ViewedLink]) -> int:
        return self.range_ns[1]  # the end, if no time is chosen

    def step_ns(self, names: Sequence[str], time_ns: int, step: int) -> int:
        found = []
        for name in names:
            stamps_ns = self._stamps_ns.get(name)
            if stamps_ns is None:
                continue
            if step > 0:
                at = int(np.searchsorted(stamps_ns, time_ns, "right"))
            else:
                at = int(np.searchsorted(stamps_ns, time_ns)) - 1
            if 0 <= at < len(stamps_ns):
                found.append(int(stamps_ns[at]))
        return (min(found) if step > 0 else max(found)) if found else time_ns

    def spans_ns(self, name: str) -> list[tuple[int, int]]:
        stamps_ns = self._stamps_ns.get(name)
        if stamps_ns is None:
            return []
        steps_ns = np.diff(stamps_ns)
        period_ns = float(np.median(steps_ns)) if len(steps_ns) else 0.0
        parts = np.split(
            stamps_ns, np.flatnonzero(steps_ns > max(_PAUSE_NS, PAUSE_PERIODS * period_ns)) + 1
        )
        return [(int(part[0]), int(part[-1])) for part in parts]

    def trouble(self) -> str | None:
        return None


def _read(
    recording: Recording, tree: TransformTree, on_messages: Callable[[int], None] | None
) -> dict[str, NDArray[np.int64]]:
    """Commit a recording. Returns the stamps of each frame whose link is not static, sorted."""
    found: dict[str, list[NDArray[np.int64]]] = {}
    done = 0
    for block in recording.blocks():
        done += block.messages
        if on_messages is not None:
            on_messages(done)
        for rows in valid_commits(recording, tree, block.rows, block.static):
            if block.static:
                continue
            order = np.argsort(rows.child, kind="stable")
            children, begins = np.unique(rows.child[order], return_index=True)
            parts = np.split(rows.stamp[order].astype(np.int64), begins[1:])
            for child, stamps_ns in zip(children.tolist(), parts, strict=True):
                # The tree drops a slash at the begin of a name, as tf2 does.
                found.setdefault(rows.names[child].removeprefix("/"), []).append(stamps_ns)
    return {name: np.unique(np.concatenate(parts)) for name, parts in found.items()}
