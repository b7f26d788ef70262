"""Follows a session's link: ends it when nothing answers there, or when a better one can be had.

Zenoh connects again by itself, through its list of endpoints in their order, as soon as a link
breaks: when its router ends or refuses. A router that is stopped or cut off it gives up after its
lease only, 10 s. So while a reply is awaited, or a stream followed, and nothing is heard, the watch
asks the router for liveliness tokens. It answers from its tables, also when its server is busy. If
it does not, the watch shuts the link's socket down, and Zenoh does the rest. That needs a socket of
TCP (tcp, tls, ws) and `/proc`; elsewhere Zenoh's lease decides.

In the same way the client returns: away from the first endpoint, a probe asks now and then whether
one before the current one is served again.

Thread safety: all methods. A thread of its own does the work.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from typing import Any, Final

import zenoh
from zenoh.handlers import RingChannel

from zenoh_tf import threads
from zenoh_tf._net import keys, link_sockets, zenoh_config
from zenoh_tf.errors import ServerUnavailable

from ..session.calls import SessionCalls, is_forked
from ..session.connection import ConnectionUser
from .queries import WatchedQueries

#: How often the watch looks while something is under way, and while nothing is.
_TICK_S: Final = 0.05
_IDLE_S: Final = 1.0
#: The router is asked after such a silence, and must answer in this time, or in so many times that
#: of its longest answer lately.
_SILENCE_S: Final = 0.15
_ANSWER_S: Final = 0.2
_ROUND_TRIPS: Final = 4
#: Each time that a link was ended for nothing, as the same router lets the client in again at once,
#: patience doubles, up to this factor.
_MAX_PATIENCE: Final = 16
#: Pauses between probes: at first, and if the link is lost again and again.
_PROBE_S: Final = 1.0
_MAX_PROBE_S: Final = 10.0
_SETTLED_S: Final = 30.0
_QUEUED_EVENTS: Final = 64

log = logging.getLogger("zenoh_tf.client")


class LinkWatch:
    """The link of one session; see the module."""

    def __init__(
        self,
        session: zenoh.Session,
        calls: SessionCalls,
        queries: WatchedQueries,
        tree: str,
        endpoints: Sequence[str],
        *,
        on_moved: Callable[[], None],
        serves: Callable[[str], bool],
    ) -> None:
        """Calls `on_moved` after each change of the link. `serves`: whether an endpoint is worth
        to return to; it may take seconds."""
        self._session = session
        self._calls = calls
        self._queries = queries
        self._servers = keys.servers(tree)
        self._endpoints = endpoints
        self._on_moved = on_moved
        self._serves = serves
        #: Of the link that is there, or was last.
        self.endpoint = endpoints[0]
        #: By user, after which silence the router is asked.
        self._users: weakref.WeakKeyDictionary[ConnectionUser, float] = weakref.WeakKeyDictionary()
        self._closed = threading.Event()
        # What follows belongs to the watch's thread.
        self._links = 0  # that have come so far
        self._is_linked = True
        self._heard = 0
        self._heard_s = time.monotonic()
        self._round_trip_s = 0.0
        self._patience = 1
        self._ended: str | None = None  # the endpoint of a link that was ended, until another comes
        self._arrived_s = self._heard_s  # when the link came
        self._probe: threading.Thread | None = None
        self._probe_period_s = _PROBE_S
        self._next_probe_s = 0.0
        self._returns = False  # the probe has found a better endpoint
        calls.add_owner(self)
        with calls:  # not a callback: see `publish.announcer`
            self._events: zenoh.LinkEventsListener[Any] = session.info.declare_link_events_listener(
                RingChannel(_QUEUED_EVENTS), history=True
            )

    def start(self) -> None:
        """Begin."""
        self._check()
        threads.start("link watch", _follow, weakref.ref(self), self._queries.sent, self._closed)

    def close(self) -> None:
        """End the thread soon. The session's end ends the listener."""
        if not is_forked():
            self._closed.set()
            self._queries.sent.set()

    def watch_connection(self, user: ConnectionUser, silence_s: float) -> None:
        """As `Connection.watch_connection`."""
        self._users[user] = silence_s
        self._queries.sent.set()

    def check(self) -> float:
        """Do what is to be done now; returns how long to wait if no query is sent meanwhile.

        Raises ServerUnavailable if the session is closed.
        """
        try:
            return self._check()
        except zenoh.ZError as error:  # closed meanwhile
            raise ServerUnavailable(str(error)) from error

    def _check(self) -> float:
        self._read_events()
        now_s = time.monotonic()
        self._return_if_possible(now_s)
        users = [(each, s) for each, s in list(self._users.items()) if not each.closed]
        heard = self._queries.heard + sum(each.heard for each, _ in users)
        least_s = silence_s = min((s for _, s in users), default=_IDLE_S)
        if self._queries.are_under_way:
            silence_s = _SILENCE_S
        is_quiet = not users and not self._queries.are_under_way  # nothing is expected
        if heard != self._heard or is_quiet or not self._is_linked:
            self._heard, self._heard_s = heard, now_s
        elif now_s - self._heard_s >= silence_s * self._patience:
            self._check_router()
        if self._queries.are_under_way or not self._is_linked:
            return 0.0
        return least_s / 2 if users else _IDLE_S

    # --- the link

    def _read_events(self) -> None:
        """Accept what has become of the link."""
        changed = False
        while True:
            with self._calls:
                event = self._events.try_recv()
            if event is None:
                break
            self._is_linked = event.kind == zenoh.SampleKind.PUT
            changed |= self._links > 0
            if self._is_linked:
                self._links += 1
                self._arrived_s = self._heard_s = time.monotonic()
                self.endpoint = _endpoint_of(event.link.dst, self._endpoints)
                was_for_nothing = self._ended == self.endpoint
                self._patience = min(2 * self._patience, _MAX_PATIENCE) if was_for_nothing else 1
                self._ended = None
        if changed:
            log.info("connected to %s", self._shown() if self._is_linked else "no server")
            if self._is_linked:
                self._ask_router(_ANSWER_S)  # its keys come before its answer
            self._report_change()
            self._queries.end_all()

    def _check_router(self) -> None:
        """End the link if its router does not answer."""
        patience_s = max(_ANSWER_S * self._patience, _ROUND_TRIPS * self._round_trip_s)
        heard, begin_s = self._queries.heard, time.monotonic()
        has_answered = self._ask_router(patience_s)
        self._heard_s = now_s = time.monotonic()
        if has_answered:
            self._patience = 1
            self._round_trip_s = max(now_s - begin_s, self._round_trip_s / 2)
        elif self._queries.heard == heard:
            log.warning("%s does not answer: connecting again", self._shown())
            self._ended = self.endpoint
            self._end_link()

    def _ask_router(self, timeout_s: float) -> bool:
        """Whether the router answers in time."""
        with self._calls:
            answers = self._session.liveliness().get(self._servers, timeout=timeout_s)
            return all(each.ok is not None for each in answers)  # else it has timed out

    def _report_change(self) -> None:
        self._on_moved()
        for user in list(self._users):
            user.connection_changed()

    def _end_link(self) -> None:
        """Shut the link's socket down: Zenoh finds it broken, and connects again."""
        self._report_change()  # before the new link brings anything
        with self._calls:
            links = self._session.info.links()
        for link in links:
            if not link_sockets.shut(link.src, link.dst):
                log.debug("the socket of %s is not known: waiting for Zenoh", link.dst)

    def _shown(self) -> str:
        return zenoh_config.address(self.endpoint)

    # --- returning

    def _return_if_possible(self, now_s: float) -> None:
        """Look for a better endpoint now and then, and change to one that was found."""
        place = self._endpoints.index(self.endpoint)
        if place == 0 or not self._is_linked:
            self._returns = False
            if now_s - self._arrived_s > _SETTLED_S:
                self._probe_period_s = _PROBE_S
        elif self._returns:
            self._returns = False
            self._probe_period_s = min(2 * self._probe_period_s, _MAX_PROBE_S)
            log.info("an endpoint before %s answers again: returning", self._shown())
            self._end_link()
        elif now_s >= self._next_probe_s and (self._probe is None or not self._probe.is_alive()):
            self._next_probe_s = now_s + self._probe_period_s
            self._probe = threads.start("probe", self._look_for_better, self._endpoints[:place])

    def _look_for_better(self, endpoints: Sequence[str]) -> None:
        if any(self._serves(endpoint) for endpoint in endpoints if not self._closed.is_set()):
            self._returns = True
            self._queries.sent.set()


def _endpoint_of(dst: str, endpoints: Sequence[str]) -> str:
    """The first endpoint that leads to a link's other end; the first one of all if none does."""
    for endpoint in endpoints:
        if zenoh_config.address(endpoint) == zenoh_config.address(dst):
            return endpoint
    for endpoint in endpoints:
        if dst in _resolved(endpoint):
            return endpoint
    return endpoints[0]


def _resolved(endpoint: str) -> set[str]:
    """The addresses that the name in an endpoint stands for."""
    protocol, _, where = zenoh_config.address(endpoint).partition("/")
    host, _, port = where.rpartition(":")
    try:
        found = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_STREAM)
    except OSError:  # an unknown name, or a path
        return set()
    addresses = {str(each[4][0]) for each in found}
    return {
        f"{protocol}/[{each}]:{port}" if ":" in each else f"{protocol}/{each}:{port}"
        for each in addresses
    }


def _follow(
    watch_ref: weakref.ref[LinkWatch], sent: threading.Event, closed: threading.Event
) -> None:
    """Check until the watch is closed or collected."""
    while not closed.wait(_TICK_S):
        watch = watch_ref()
        if watch is None:
            return
        sent.clear()
        idle_s = 0.0
        try:
            idle_s = watch.check()
        except ServerUnavailable:  # the session is closed
            return
        except Exception:  # no error may end it
            log.exception("internal error while following the link")
        del watch  # or the wait would keep it alive
        if idle_s:
            sent.wait(idle_s)
