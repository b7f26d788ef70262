"""Listens to the server of one robot, over a Zenoh session of its own.

A robot that is away, frozen or wrong holds up its own threads only. Its feed continues by itself
when it is back, also with another server: see `zenoh_tf.mirrors.feed`.

Thread safety: all methods.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import zenoh

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf._net import connect_failure, zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf.errors import TransformException
from zenoh_tf.mirrors.feed import MirrorFeed

from ..ingest.ingest import Ingest
from ..ingest.put_queues import Put
from ..limits import Limits
from ..process.network import open_client_session
from ..process.upstream import Upstream
from ..rate_limited_log import RateLimitedLog
from ..requests.service import Service
from .quota import FrameQuota
from .rows import Rows
from .settings import Link

#: How long one attempt to connect may take.
CONNECT_TIMEOUT_S: Final = 5.0
#: A robot's server says something ten times a second, but its state has the period's age.
_SILENT_S: Final = 2.0
#: The longest age that is reported.
_MAX_AGE_S: Final = 1e9
_PAUSE_S: Final = 1.0
#: Puts that are queued at once.
_BATCH_BYTES: Final = 1 << 20

log = logging.getLogger("zenoh_tf.server.federation")


class Robot:
    """Adds what is committed to a robot's tree to the put queues, from `start` to `close`."""

    def __init__(
        self,
        link: Link,
        shared: tuple[str, ...],
        credentials: Credentials,
        limits: Limits,
        service: Service,
        share: int,
    ) -> None:
        """`share`: how many frames of the tree it may have, unless its link says so."""
        self.name = link.name
        self._link = link
        interest = link.share.interest
        self._silent_s = _SILENT_S + (interest.period_ns / 1e9 if interest else 0.0)
        if zenoh_config.protocol(link.endpoint) not in zenoh_config.TLS_PROTOCOLS:
            credentials = replace(credentials, ca=None, certificate=None, key=None)
        self._credentials = credentials
        self._limits = limits
        self._own_instance = service.instance
        self._refusals = service.refusals
        self._quota_log = RateLimitedLog(log)
        self._ingest: Ingest | None = None
        self._closed = threading.Event()
        self._lock = threading.Lock()  # of the next two
        self._session: zenoh.Session | None = None
        self._feed: MirrorFeed | None = None
        # The rest is guarded by the feed's lock.
        self._quota = FrameQuota(link.name, service.tree, link.share.max_frames or share)
        self._rows = Rows(link.name, shared, limits.rows, self._quota, self._refuse)
        self._copy_seq = 0  # of the last commit in the copy that began
        self._is_self = False

    def start(self, ingest: Ingest) -> None:
        """Connect and listen, in the background."""
        self._ingest = ingest
        threads.start(f"robot {self.name}", self._connect)

    def close(self) -> None:
        """Listen no more. Returns at once: closing the session of a frozen robot may last long."""
        self._closed.set()
        with self._lock:
            feed, session = self._feed, self._session
            self._feed = self._session = None
        if feed is not None and session is not None:
            threads.start("robot leave", _leave, feed, session)

    def counters(self) -> dict[str, Any]:
        """Counters for `stats`."""
        feed, rows = self._feed, self._rows
        age_s = _MAX_AGE_S if feed is None else min(feed.age_s(), _MAX_AGE_S)
        return {
            "connected": int(age_s < self._silent_s),
            "age_s": age_s,
            "snapshots": 0 if feed is None else feed.snapshots,
            "received": rows.received,
            "left_out": rows.left_out,
            "over_quota": rows.over_quota,
            "frames": len(self._quota),
            "max_frames": self._quota.most,
            "removals": rows.removals,
        }

    # --- the thread that connects

    def _connect(self) -> None:
        is_first = True
        while not self._closed.is_set():
            try:
                session = open_client_session(
                    self._link.endpoint, CONNECT_TIMEOUT_S, self._limits, self._credentials
                )
            except zenoh.ZError as error:
                log.debug("robot %r: %s", self.name, error)
                if is_first:
                    self._warn()
                is_first = False
                self._closed.wait(_PAUSE_S)
                continue
            try:
                self._listen(session)
            except (zenoh.ZError, TransformException) as error:
                log.warning("robot %r: %s; connecting again", self.name, error)
                session.close()
                self._closed.wait(_PAUSE_S)
                continue
            return

    def _warn(self) -> None:
        link = self._link
        failure = connect_failure.explain(
            link.endpoint, link.tree, CONNECT_TIMEOUT_S, self._credentials
        )
        log.warning("robot %r cannot be reached yet, trying on: %s", self.name, failure)

    def _listen(self, session: zenoh.Session) -> None:
        interest = self._link.share.interest
        name = f"the server of robot {self.name!r}"
        source = Upstream(session, self._link.tree, name, interest=interest)
        feed = MirrorFeed(source, self._on_copy, interest, observer=self, keeps_tree=False)
        with self._lock:
            is_late = self._closed.is_set()
            if not is_late:
                self._session, self._feed = session, feed
        if is_late:
            _leave(feed, session)
            return
        try:
            feed.wait_for_copy(CONNECT_TIMEOUT_S)
        except TransformException as error:
            if not self._closed.is_set():
                log.warning("robot %r has not sent its tree yet, trying on: %s", self.name, error)

    # --- what the feed calls, under its lock; see `mirrors.copy.Observer`

    def begin(self, instance: str, seq: int) -> None:
        """A snapshot begins."""
        self._copy_seq = seq
        self._is_self = instance == self._own_instance
        if self._is_self:
            log.error(
                "--mirror-of %s=... leads to this server itself: nothing is mirrored",
                self.name,
            )

    def load(self, frames: wire.Frames) -> None:
        """Queue frames of a snapshot. Waits for room for a moment: the stream waits meanwhile."""
        self._add(self._rows.of_frames(frames), wait=True)

    def apply(self, message: wire.StreamMessage) -> None:
        """Queue the changes of a message."""
        if message.changes is not None:
            is_copy = message.last <= self._copy_seq  # all that there is of an interest
            self._add(self._rows.of_changes(message.changes, is_copy=is_copy), wait=is_copy)

    def _refuse(self, authority: str, rows: int, error: TransformException) -> None:
        """Count and log rows of frames above the robot's quota."""
        reason = f"{type(error).__name__}: {error}"
        self._refusals.refuse(authority, rows, reason)
        self._quota_log.warn(f"robot {self.name!r}", reason)

    def _on_copy(self, tree: TransformTree | None, instance: str) -> None:
        if tree is not None and not self._is_self:
            log.info("robot %r: its tree is complete (instance %s)", self.name, instance)

    def _add(self, puts: Iterator[Put], *, wait: bool) -> None:
        assert self._ingest is not None
        if self._is_self or self._closed.is_set():
            return
        batch: list[Put] = []
        size = 0
        for put in puts:
            batch.append(put)
            size += put.size
            if size >= _BATCH_BYTES:
                self._ingest.add(batch, wait=wait)
                batch, size = [], 0
        if batch:
            self._ingest.add(batch, wait=wait)


def _leave(feed: MirrorFeed, session: zenoh.Session) -> None:
    feed.close()
    session.close()
