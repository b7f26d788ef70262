"""Publishing a recording's transforms, and knowing when the server has them all."""

from __future__ import annotations

import time
from collections.abc import Iterable

from zenoh_tf import LookupException, StampedTransform
from zenoh_tf_client import TransformClient
from zenoh_tf_client.cli.errors import CommandError

#: Transforms in one put. One put is one commit, so it also bounds how long one takes.
_BATCH = 500

_POLL_S = 0.005


class Feed:
    """Sends transforms in order, in puts of many rows.

    ``transforms`` counts what was sent; after ``finish`` all of it has been ingested.
    """

    def __init__(self, tf: TransformClient, authority: str, patience_s: float) -> None:
        self._tf = tf
        self._broadcaster = tf.broadcaster(authority)
        self._patience_s = patience_s
        self._rows: list[StampedTransform] = []
        self._parents: dict[str, str] = {}
        self._static = False
        self._puts = 0
        self._last: list[StampedTransform] = []
        self._before = tf.stats()
        self._instance = tf.instance
        self.transforms = 0
        self.dropped_as_too_old = 0

    def add(self, transforms: Iterable[StampedTransform], *, static: bool) -> None:
        """Queue transforms; sends when enough have gathered."""
        for row in transforms:
            # Rows of one put are one instant to the tree: a child that changes its parent
            # must do so from one put to the next, or the tree may see a loop that never was.
            moved = self._parents.get(row.child_frame, row.parent_frame) != row.parent_frame
            if static != self._static:
                # Static links travel on a key of their own, and keys do not wait for each other.
                self.finish()
                self._static = static
            elif moved or len(self._rows) >= _BATCH:
                self.flush()
            self._parents[row.child_frame] = row.parent_frame
            self._rows.append(row)

    def flush(self) -> None:
        """Send what has been added."""
        if not self._rows:
            return
        if self._static:
            self._broadcaster.send_static(self._rows)
        else:
            self._broadcaster.send(self._rows)
        self.transforms += len(self._rows)
        self._puts += 1
        self._last, self._rows = self._rows, []
        self._parents = {}

    def finish(self) -> None:
        """Send the rest and wait until the server has ingested everything.

        Raises CommandError if the server refused some of it, was restarted, or gets no further.
        """
        self.flush()
        taken, give_up = -1, 0.0
        while True:
            stats = self._tf.stats()
            if self._tf.instance != self._instance:
                raise CommandError("the server was restarted; what it had before is lost")
            refused = self._since(stats, "bad_puts")
            if refused:
                raise CommandError(
                    f"the server refused {refused} messages, from here or from others; "
                    "its log says why"
                )
            now = self._since(stats, "puts")
            # Others may publish too and be counted. So the last put must be there as well:
            # puts on one key are ingested in order.
            if now >= self._puts and self._last_is_there():
                self.dropped_as_too_old = self._since(stats, "dropped_as_too_old")
                return
            if now > taken:
                taken, give_up = now, time.monotonic() + self._patience_s
            elif time.monotonic() > give_up:
                raise CommandError(
                    f"the server has {now:,} of {self._puts:,} messages, and got none in the last "
                    f"{self._patience_s:g} s"
                )
            time.sleep(_POLL_S)

    def _last_is_there(self) -> bool:
        newest = {row.child_frame: row.stamp_ns for row in self._last}
        for child, stamp_ns in newest.items():
            try:
                frame = self._tf.frame(child)
            except LookupException:
                return False
            if not frame.static and (frame.newest_stamp_ns or 0) < stamp_ns:
                return False
        return True

    def _since(self, stats: dict[str, int], counter: str) -> int:
        return stats[counter] - self._before[counter]
