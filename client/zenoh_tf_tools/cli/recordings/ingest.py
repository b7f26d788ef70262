"""Publishes a recording's transforms, and knows when the server has ingested all of them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final

from zenoh_tf import AuthorityInfo, LookupException, ServerUnavailable, StampedTransform
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.records import frame_infos
from zenoh_tf_tools.errors import CommandError

#: Transforms in one put. A put is one commit, so this also bounds the time of a commit.
_BATCH: Final = 500
_POLL_S: Final = 0.005
#: How often a feed that may continue with another server asks whether it has to.
_CHECK_S: Final = 1.0
#: Pause before the next attempt to find a server.
_RETRY_S: Final = 0.2
_NOTHING: Final = AuthorityInfo("", 0, 0, 0, 0, 0, 0)


class ServerWasRestarted(CommandError):
    """The server is another one than at the begin, so it lacks what was sent before."""


class Feed:
    """Sends transforms in order, in puts of many rows. Thread safety: none.

    ``transforms`` counts those sent. After ``finish`` the server has ingested all of them.
    ``dropped_as_too_old`` counts those that were older than its cache time, ``strays`` those far
    ahead of what it had until more followed, and ``refused`` those that it did not accept for
    another reason, such as ``last_refusal``. These rest on the server's counters of the authority,
    so nobody else should publish as that authority.
    """

    def __init__(
        self,
        tf: TransformClient,
        authority: str,
        patience_s: float,
        on_lost: Callable[[ServerUnavailable | ServerWasRestarted], None] | None = None,
    ) -> None:
        """`on_lost`: called with the reason when the server ends or was restarted, in place of an
        error. Then the feed waits for a server, and continues; the counters restart from zero. The
        broadcaster sends its static links to the new server."""
        self._tf = tf
        self._on_lost = on_lost
        self._check_at_s = time.monotonic() + _CHECK_S
        self._authority = authority
        self._broadcaster = tf.broadcaster(authority)
        self._patience_s = patience_s
        self._rows: list[StampedTransform] = []
        self._parents: dict[str, str] = {}
        self._static = False
        self._last: list[StampedTransform] = []
        self._sent_samples: Counter[str] = Counter()  # by child frame, without static links
        self.transforms = 0
        self.dropped_as_too_old = self.refused = self.strays = 0
        self.last_refusal: str | None = None
        self._instance = tf.instance
        self._before = self._counted()

    def add(self, transforms: Iterable[StampedTransform], *, static: bool) -> None:
        """Queue transforms, and send them when there are enough for a put."""
        for row in transforms:
            # The rows of a put are committed at one instant. A child that changes its parent
            # needs two puts, or the tree may see a loop that never was.
            moved = self._parents.get(row.child_frame, row.parent_frame) != row.parent_frame
            # The server ingests all puts of an authority in the order in which they were sent.
            if static != self._static or moved or len(self._rows) >= _BATCH:
                self.flush()
                self._static = static
            self._parents[row.child_frame] = row.parent_frame
            self._rows.append(row)

    def flush(self) -> None:
        """Send what has been queued."""
        if not self._rows:
            return
        if self._static:
            self._broadcaster.send_static(self._rows)
        else:
            self._broadcaster.send(self._rows)
            self._sent_samples.update(row.child_frame for row in self._rows)
        self.transforms += len(self._rows)
        self._last, self._rows = self._rows, []
        self._parents = {}
        if self._on_lost is not None and time.monotonic() >= self._check_at_s:
            try:
                self._counted()
            except (ServerUnavailable, ServerWasRestarted) as error:
                self._continue(error)
            self._check_at_s = time.monotonic() + _CHECK_S

    def finish(self) -> None:
        """Send the rest and wait until the server has ingested everything.

        Raises:
            CommandError: The server was restarted, or makes no progress.
        """
        self.flush()
        try:
            self._wait_until_ingested()
        except (ServerUnavailable, ServerWasRestarted) as error:
            self._continue(error)

    def _wait_until_ingested(self) -> None:
        ingested_before, give_up_s = -1, 0.0
        while True:
            counted = self._counted()
            refused = max(0, counted.refused - self._before.refused)
            dropped = counted.dropped - self._before.dropped
            ingested = counted.stored - self._before.stored + dropped + refused
            # The counters may run ahead if somebody else publishes as the same authority, so the
            # last put must be there as well: the puts on one key are ingested in order.
            if ingested >= self.transforms and (refused or self._last_is_there()):
                self.strays = _strays(counted) - _strays(self._before)
                self.dropped_as_too_old, self.refused = dropped, refused - self.strays
                self.last_refusal = counted.last_refusal
                return
            if ingested > ingested_before:
                ingested_before, give_up_s = ingested, time.monotonic() + self._patience_s
            elif time.monotonic() > give_up_s:
                raise CommandError(
                    f"the server ingested {ingested:,} of {self.transforms:,} transforms, and none "
                    f"in the last {self._patience_s:g} s; try a longer --timeout"
                )
            time.sleep(_POLL_S)

    def _continue(self, lost: ServerUnavailable | ServerWasRestarted) -> None:
        """Wait for a server, and count from here on; raises `lost` if nobody wants that."""
        if self._on_lost is None:
            raise lost
        self._on_lost(lost)
        while True:
            try:
                self._tf.stats()
                self._instance = self._tf.instance
                self._before = self._counted()
                break
            except (ServerUnavailable, ServerWasRestarted):
                time.sleep(_RETRY_S)
        self.transforms = 0
        self._sent_samples.clear()

    def no_longer_kept(self) -> int:
        """Transforms that the server stored, and whose samples have left its cache since. Call it
        after ``finish``. An estimate if others write the same frames."""
        kept = sum(
            min(frame.samples, self._sent_samples[frame.name])
            for frame in frame_infos(self._tf, list(self._sent_samples))
            if not frame.static
        )
        rewritten = self._counted().rewritten - self._before.rewritten
        refused = self.refused + self.strays
        stored = self._sent_samples.total() - self.dropped_as_too_old - refused - rewritten
        return max(0, stored - kept)

    def refusal(self) -> CommandError | None:
        """What the server has refused, as an error; None if it has refused nothing."""
        if not self.refused:
            return None
        return CommandError(
            f"the server refused {self.refused:,} of the {self.transforms:,} transforms sent as "
            f"{self._authority!r}, and stored the others; the last reason: {self.last_refusal}"
        )

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

    def _counted(self) -> AuthorityInfo:
        """The server's counters of this authority. Raises ServerWasRestarted."""
        authorities = self._tf.authorities()
        if self._tf.instance != self._instance:
            raise ServerWasRestarted("the server was restarted; what it had before is lost")
        for authority in authorities:
            if authority.name == self._authority:
                return authority
        return _NOTHING


def _strays(counted: AuthorityInfo) -> int:
    return counted.refused_by_reason.get("stray", 0)
