"""Listens to the server of one robot, over a Zenoh session of its own, or over the site's.

A robot that is away, frozen or wrong holds nobody up: see `pool`. Its feed continues by itself
when it is back, also with another server: see `zenoh_tf.mirrors.feed`.

Thread safety: all methods.
"""

from __future__ import annotations

import asyncio
import functools
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

import zenoh

from zenoh_tf import TransformTree, admission, threads, wire
from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._zenoh import connect_failure
from zenoh_tf.errors import TransformException
from zenoh_tf.mirrors.feed import MirrorFeed

from ..ingest.put_queues import Put
from ..process.network import open_client_session
from ..process.upstream import Upstream
from ..rate_limited_log import RateLimitedLog
from ..requests.service import Service
from . import shared_streams
from .pool import Pool
from .quota import FrameQuota
from .rows import RobotRows
from .settings import RobotAddress
from .shared_streams import Inbox, SharedStreams

#: How long one attempt to connect may take.
CONNECT_TIMEOUT_S: Final = 5.0
#: A robot's server says something ten times a second, but its state has the period's age.
_SILENT_S: Final = 2.0
#: The longest age that is reported.
_MAX_AGE_S: Final = 1e9
#: So often it is looked whether it is heard.
_WATCH_PERIOD_S: Final = 0.5
#: Between attempts to connect, which grow to the last one, and the time that each may take.
_PAUSE_S: Final = 1.0
_LONGEST_PAUSE_S: Final = 8.0
_RETRY_TIMEOUT_S: Final = 1.0

log = logging.getLogger("zenoh_tf.server.federation")


class RobotTree:
    """Adds what is committed to a robot's tree to the put queues, from `start` to `close`."""

    def __init__(
        self,
        address: RobotAddress,
        shared: tuple[str, ...],
        credentials: Credentials,
        service: Service,
        share: int,
        pool: Pool,
        *,
        is_there: Callable[[], bool] = lambda: True,
        is_found: bool = False,
    ) -> None:
        """`share`: how many frames of the tree it may have, unless its address says so. It is asked
        only while `is_there()`. One that `is_found`, not listed, takes no frames of others."""
        self._is_there = is_there
        self.name = address.name
        self._address = address
        interest = address.share.interest
        self._silent_s = _SILENT_S + (interest.period_ns / 1e9 if interest else 0.0)
        if zenoh_config.protocol(address.endpoint) not in zenoh_config.TLS_PROTOCOLS:
            credentials = replace(credentials, ca=None, certificate=None, key=None)
        self._credentials = credentials
        self._limits = service.limits
        self._pool = pool
        self._own_instance = service.instance
        self._refusals = service.refusals
        self._quota_log = RateLimitedLog(log)
        self._streams: SharedStreams | None = None
        self._lock = threading.Lock()  # of the next three
        self._runs = 0  # how often it was closed
        self._session: zenoh.Session | None = None
        self._feed: MirrorFeed | None = None
        # The rest is guarded by the feed's lock.
        most = address.share.max_frames or share
        self._quota = FrameQuota(address.name, service.tree, most, guards_others=is_found)
        self._rows = RobotRows(address.name, shared, self._limits.rows, self._quota, self._refuse)
        self.has_copy = False  #: Its copy was complete once.
        self._copy_seq = 0  # of the last commit in the copy that began
        self._is_self = False

    def start(
        self, session: zenoh.Session | None = None, streams: SharedStreams | None = None
    ) -> None:
        """Listen, in the background: over a session and streams that there are, or its own."""
        self._streams = streams
        self._pool.spawn(self._connect() if session is None else self._listen(session))

    def close(self) -> None:
        """Listen no more, until it is started again. Returns at once: closing the session of a
        frozen robot may last long."""
        with self._lock:
            feed, session = self._feed, self._session
            self._feed = self._session = None
            self._runs += 1
        if feed is not None and session is None:
            self._pool.spawn(_stop(feed))
        elif feed is not None:
            threads.start("robot leave", _leave, feed, session)

    @property
    def has_frames(self) -> bool:
        """Whether it has frames here, or has had some."""
        return len(self._quota) > 0

    @property
    def is_answered(self) -> bool:
        """Whether its server has begun to send its tree."""
        feed = self._feed
        return feed is not None and feed.snapshots > 0

    @property
    def age_s(self) -> float:
        """How old what is known of its tree is, at most."""
        feed = self._feed
        return _MAX_AGE_S if feed is None else min(feed.age_s(), _MAX_AGE_S)

    @property
    def lost_s(self) -> float | None:
        """For how many seconds its server is not heard; None if it is."""
        age_s = self.age_s
        return None if age_s < self._silent_s else age_s

    def counters(self) -> dict[str, Any]:
        """Counters for `stats`."""
        feed, rows = self._feed, self._rows
        return {
            "connected": int(self.lost_s is None),
            "age_s": self.age_s,
            "snapshots": 0 if feed is None else feed.snapshots,
            "received": rows.received,
            "left_out": rows.left_out,
            "over_quota": rows.over_quota,
            "frames": len(self._quota),
            "max_frames": self._quota.most,
            "removals": rows.removals,
        }

    # --- on the pool's thread

    async def _connect(self) -> None:
        run, is_first = self._runs, True
        pauses = threads.pauses(_PAUSE_S, _LONGEST_PAUSE_S)
        while run == self._runs:
            try:
                session = await self._pool.block(
                    open_client_session,
                    self._address.endpoint,
                    CONNECT_TIMEOUT_S if is_first else _RETRY_TIMEOUT_S,
                    self._limits,
                    self._credentials,
                )
            except zenoh.ZError as error:
                log.debug("robot %r: %s", self.name, error)
                if is_first:
                    await self._pool.block(self._warn)
                is_first = False
                await asyncio.sleep(next(pauses))
                continue
            try:
                await self._listen(session, is_own=True)
            except (zenoh.ZError, TransformException) as error:
                log.warning("robot %r: %s; connecting again", self.name, error)
                await self._pool.block(session.close)
                await asyncio.sleep(_PAUSE_S)
                continue
            return

    def _warn(self) -> None:
        address = self._address
        failure = connect_failure.explain(
            address.endpoint, address.tree, CONNECT_TIMEOUT_S, self._credentials
        )
        log.warning("robot %r cannot be reached yet, trying on: %s", self.name, failure)

    async def _listen(self, session: zenoh.Session, *, is_own: bool = False) -> None:
        run, interest = self._runs, self._address.share.interest
        name = f"the server of robot {self.name!r}"
        tree, streams = self._address.tree, self._streams
        if streams is None:
            listen = functools.partial(self._subscribe, session)
        else:
            listen = functools.partial(streams.inbox, tree)
        source = Upstream(
            session, tree, name, interest=interest, listen=listen, is_there=self._is_there
        )
        feed = MirrorFeed(
            source,
            self._on_copy,
            interest,
            observer=self,
            keeps_tree=False,
            runner=self._pool,
            room=self._pool.room,
        )
        own_session = session if is_own else None
        with self._lock:
            is_late = run != self._runs
            if not is_late:
                self._session, self._feed = own_session, feed
        if is_late:
            threads.start("robot leave", _leave, feed, own_session)
            return
        await asyncio.sleep(CONNECT_TIMEOUT_S)
        try:
            feed.wait_for_copy(0)
        except TransformException as error:
            if run == self._runs:
                log.warning("robot %r has not sent its tree yet, trying on: %s", self.name, error)
        await self._report_losses(run)

    def _subscribe(self, session: zenoh.Session) -> Inbox:
        """Listen to its stream over a session of its own."""
        streams = shared_streams.of_robot(session, self._address, self._pool.room)
        self._pool.add_streams(streams)
        return streams.inbox(self._address.tree, ended=streams.close)

    async def _report_losses(self, run: int) -> None:
        """Log once when its server is not heard any more, and once when it is again."""
        since_s: float | None = None
        while run == self._runs:
            lost_s, now_s = self.lost_s, time.monotonic()
            if lost_s is not None and lost_s < _MAX_AGE_S and since_s is None:
                since_s = now_s - lost_s
                log.warning(
                    "robot %r: its server is not heard for %.1f s: its last poses are served",
                    self.name,
                    lost_s,
                )
            elif lost_s is None and since_s is not None:
                log.info(
                    "robot %r: its server is heard again after %.1f s", self.name, now_s - since_s
                )
                since_s = None
            await asyncio.sleep(_WATCH_PERIOD_S)

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

    def load(self, frames: bytes) -> None:
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
        self._refusals.refuse(authority, {admission.QUOTA: rows}, reason)
        self._quota_log.warn(f"robot {self.name!r}", reason)

    def _on_copy(self, tree: TransformTree | None, instance: str) -> None:
        if tree is not None and not self._is_self:
            self.has_copy = True
            log.info("robot %r: its tree is complete (instance %s)", self.name, instance)

    def _add(self, puts: Iterator[Put], *, wait: bool) -> None:
        if not self._is_self:
            self._pool.add(puts, wait=wait)


async def _stop(feed: MirrorFeed) -> None:
    feed.close()


def _leave(feed: MirrorFeed, session: zenoh.Session | None) -> None:
    feed.close()
    if session is not None:
        session.close()
