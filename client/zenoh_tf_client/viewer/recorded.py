"""A recording as a tree that can be looked at at any of its times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformException, TransformTree
from zenoh_tf_client.cli.errors import CommandError
from zenoh_tf_client.cli.recording import open_recording
from zenoh_tf_client.viewer.source import Link, Lookups

#: The rate of a link is that of its samples in this long before the time.
_RATE_NS = 5 * 10**9


class RecordedSource:
    """A recording; what is shown at a time is what its samples say about that time."""

    def __init__(self, path: Path) -> None:
        """Read a recording.

        Raises:
            CommandError: It cannot be read, or has no transforms.
        """
        # No sample is too old, and none is one too many.
        self._tree = TransformTree(cache_time_s=1e9, max_samples_per_frame=1 << 30)
        #: The stamps of each dynamic link, sorted; its history tells only the first and last one.
        self._stamps_ns: dict[str, NDArray[np.int64]] = {}
        stamps: dict[str, list[int]] = {}
        with open_recording(path) as recording:
            for message in recording.messages():
                try:
                    self._tree.set_transforms_xact(
                        message.transforms, authority=message.topic, static=message.static
                    )
                except TransformException:
                    continue
                for stamped in () if message.static else message.transforms:
                    stamps.setdefault(stamped.child_frame, []).append(stamped.stamp_ns)
        for name, times in stamps.items():
            self._stamps_ns[name] = np.unique(np.array(times, np.int64))
        self._names = self._tree.frames()
        if not self._names:
            raise CommandError(f"{path}: no transforms")
        firsts = [int(times[0]) for times in self._stamps_ns.values()] or [0]
        lasts = [int(times[-1]) for times in self._stamps_ns.values()] or [0]
        self.range_ns = (min(firsts), max(lasts))

    @property
    def lookups(self) -> Lookups:
        return self._tree

    def chain(self, target: str, source: str, time_ns: int) -> list[str]:
        """The frames from target to source at a time. Raises as `TransformTree.chain`."""
        return self._tree.chain(target, source, time_ns)

    def names(self) -> list[str]:
        return self._names

    def link(self, name: str, time_ns: int) -> Link | None:
        frame = self._tree.frame(name)
        stamps_ns = self._stamps_ns.get(name)
        if frame.parent is None or frame.static or stamps_ns is None:
            return Link(
                name, frame.parent, frame.static, frame.newest_stamp_ns, None, None, frame.authority
            )
        sample_ns = int(min(max(time_ns, stamps_ns[0]), stamps_ns[-1]))
        # The samples up to the time, or the first one.
        known = max(1, int(np.searchsorted(stamps_ns, time_ns, "right")))
        since = int(np.searchsorted(stamps_ns, stamps_ns[known - 1] - _RATE_NS))
        span_ns = int(stamps_ns[known - 1] - stamps_ns[since])
        return Link(
            name,
            self._tree.parent(name, sample_ns),
            False,
            sample_ns,
            (time_ns - int(stamps_ns[known - 1])) / 1e9,
            (known - 1 - since) * 1e9 / span_ns if span_ns else None,
            frame.authority,
        )

    def now_ns(self, links: Sequence[Link]) -> int:
        raise NotImplementedError  # the panel's slider says what is shown

    def trouble(self) -> str | None:
        return None
