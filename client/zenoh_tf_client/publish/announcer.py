"""Sends a broadcaster's static transforms again to each new server instance.

A server that restarts without a state has lost them. The same instance still has them, so a mere
reconnect sends nothing but what was sent shortly before the connection ended, as it may not have
arrived: an operator may have corrected or removed one meanwhile. Transforms that were sent while no
server was there go to the next one as they are. The others are marked as an announcement, which the
server applies only where no call and nobody else has changed or removed the link.

What is to be sent again is taken out of its set before it is sent, and put back unless a reply
confirms that it has arrived. The reply proves that only if it came over the same connection: so it
counts only if that server was not reported gone since.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import weakref
from collections.abc import Sequence
from typing import Any, Final

import zenoh
from zenoh.handlers import RingChannel

from zenoh_tf import StampedTransform, threads
from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable

from ..session.connection import Connection
from ..session.server_info import ServerInfo
from .publisher import Publisher, message, undeclare_unless_closed

log = logging.getLogger("zenoh_tf.client")

#: How often the thread checks for a new server. It checks, and does not wait inside Zenoh: a thread
#: that returns from there while Python ends would abort the process.
_PERIOD_S: Final = 0.2
#: Reports of servers between two looks; the newest count.
_QUEUED_REPORTS: Final = 64
#: An announcement that failed is repeated after this time at most.
_MAX_RETRY_S: Final = 5.0
#: What was sent so long before the connection ended may not have arrived: Zenoh notices after 10 s
#: that a network is cut.
_MAY_BE_LOST_S: Final = 20.0
#: A message of an announcement, even if the server accepts more.
_MESSAGE_BYTES: Final = 1 << 20
_MESSAGE_ROWS: Final = 4096


class Announcer:
    """Keeps the static transforms of one broadcaster, and follows the servers of its tree."""

    def __init__(self, connection: Connection, publisher: Publisher) -> None:
        """Follow the servers. Raises ServerUnavailable if the connection is closed."""
        self._connection = connection
        self._publisher = publisher
        self._lock = threading.Lock()
        # Guarded by the lock.
        self._statics: dict[str, StampedTransform] = {}
        self._unsent: set[str] = set()  # child frames that were sent while no server was there
        self._sent_s: dict[str, float] = {}  # when each child frame was sent last
        self._may_be_lost: set[str] = set()  # child frames that a server may not have received
        self._receiver: str | None = None  # what is informed now; None once it was reported gone
        self._informed = connection.known_instance  # has all that is not in _unsent
        self._present = {each for each in (self._informed,) if each}  # the servers that are there
        self._may_be_new = False  # one of them
        self._closed = threading.Event()
        self._next_try_s = 0.0
        self._retry_s = _PERIOD_S
        connection.add_user(self)
        self._servers = self._subscribe()
        threads.start("announce statics", _follow, weakref.ref(self), self._closed)

    def __len__(self) -> int:
        return len(self._statics)

    def connection_changed(self) -> None:
        """Follow the servers in the connection's new session: those of the last one are gone."""
        with self._lock, contextlib.suppress(ServerUnavailable):  # closed meanwhile
            self._read_reports()
            for instance in list(self._present):
                self._has_gone(instance)
            self._servers = self._subscribe()

    def _subscribe(self) -> zenoh.Subscriber[Any]:
        connection = self._connection
        connection.calls.add_owner(self)
        with connection.calls:
            # Not a callback: Zenoh would run it on a thread of its own, also while Python ends.
            return connection.session.liveliness().declare_subscriber(
                keys.servers(connection.tree), RingChannel(_QUEUED_REPORTS), history=True
            )

    def send(self, rows: Sequence[StampedTransform]) -> None:
        """Publish static transforms, and keep them.

        Raises LimitExceeded if they do not fit into one message, and ServerUnavailable if the
        broadcaster or its client is closed.
        """
        payload = message(rows)
        with self._lock:
            self._read_reports()
            self._publisher.put(payload)
            for row in rows:
                self._statics[row.child_frame] = row
                self._sent_s[row.child_frame] = time.monotonic()
                if not self._present:
                    self._unsent.add(row.child_frame)
                else:
                    self._unsent.discard(row.child_frame)

    def close(self) -> None:
        """Follow the servers no more. May be called again."""
        self._closed.set()
        undeclare_unless_closed(self._servers.undeclare, self._connection.calls)

    def check(self) -> None:
        """Inform a server that is new. Raises ServerUnavailable if the connection is closed."""
        with self._lock:
            self._read_reports()
            # Zenoh does not report each server that was there before a connection ended.
            lacks = bool(self._unsent or self._may_be_lost)
            is_due = lacks or (bool(self._present) and self._may_be_new)
        if not is_due or time.monotonic() < self._next_try_s:
            return
        try:
            done = self._inform()
        except Exception as error:
            if self._closed.is_set() or self._connection.closed:
                return
            self._retry_s = min(2 * self._retry_s, _MAX_RETRY_S)
            self._next_try_s = time.monotonic() + self._retry_s
            # A server that is gone again is no news.
            level = logging.DEBUG if isinstance(error, ServerUnavailable) else logging.WARNING
            log.log(
                level,
                "cannot announce static transforms, trying again in %.1f s: %s: %s",
                self._retry_s,
                type(error).__name__,
                error,
            )
            return
        if done:
            self._retry_s = _PERIOD_S

    def _read_reports(self) -> None:
        """Record which servers have come and gone. Requires the lock."""
        with self._connection.calls:
            while not self._closed.is_set():
                try:
                    token = self._servers.handler.try_recv()
                except zenoh.ZError:  # closed meanwhile
                    return
                if token is None:
                    return
                # Anyone may declare a token under a key that is no server's.
                with contextlib.suppress(InvalidArgumentException):
                    instance = keys.last_name(str(token.key_expr))
                    if token.kind == zenoh.SampleKind.PUT:
                        self._present.add(instance)
                        self._may_be_new |= instance != self._informed
                    else:
                        self._has_gone(instance)

    def _has_gone(self, instance: str) -> None:
        """Record that a server is not there any more. Requires the lock."""
        self._present.discard(instance)
        if instance == self._receiver:
            self._receiver = None
        since_s = time.monotonic() - _MAY_BE_LOST_S
        recent = {name for name, at_s in self._sent_s.items() if at_s > since_s}
        self._may_be_lost |= recent - self._unsent

    def _inform(self) -> bool:
        """Send what the server lacks. False: it does not receive puts yet."""
        with self._lock:
            self._may_be_new = False  # a server that appears from now on sets it again
        try:
            is_informed = self._send_to_server()
        except BaseException:
            self._may_be_new = True
            raise
        if not is_informed:
            self._may_be_new = True
        return is_informed

    def _send_to_server(self) -> bool:
        server = self._connection.hello()
        self._connection.check_writable()
        with self._lock:
            self._read_reports()
            self._receiver = server.instance
            unsent, self._unsent = self._unsent, set()
            lost, self._may_be_lost = self._may_be_lost, set()
            rows = {name: self._statics[name] for name in unsent}
            again = set(self._statics if server.instance != self._informed else lost) - unsent
        has_arrived = False
        try:
            has_arrived = self._put_again(unsent, again, server)
        finally:
            if not has_arrived:
                self._put_back(rows, lost)
        return has_arrived

    def _put_again(self, unsent: set[str], again: set[str], server: ServerInfo) -> bool:
        """Send statics, and return whether they have arrived."""
        if unsent or again:
            if not self._publisher.has_subscribers():
                return False
            self._send_again(list(unsent), server, announce=False)
            self._send_again(list(again), server, announce=True)
            # Its reply comes after it has received the puts, if it takes the same connection.
            if self._connection.hello().instance != server.instance:
                return False
        with self._lock:
            self._read_reports()
            if self._receiver != server.instance:
                return False
            self._informed = server.instance
        return True

    def _put_back(self, unsent: dict[str, StampedTransform], lost: set[str]) -> None:
        """Record that statics, and these rows as new ones, are still to be sent."""
        with self._lock:
            # A row that was replaced meanwhile went to a server, or counts as unsent already.
            self._unsent |= {name for name, row in unsent.items() if self._statics[name] is row}
            self._may_be_lost |= (lost | set(unsent)) - self._unsent

    def _send_again(self, frames: list[str], server: ServerInfo, *, announce: bool) -> None:
        rows = max(1, min(server.rows, _MESSAGE_ROWS))
        for start in range(0, len(frames), rows):
            self._send_chunk(frames[start : start + rows], server, announce)

    def _send_chunk(self, frames: list[str], server: ServerInfo, announce: bool) -> None:
        limit = min(server.message_bytes, _MESSAGE_BYTES)
        with self._lock:  # so that no older transform is sent after a newer one of its frame
            payload = message([self._statics[name] for name in frames], announce=announce)
            if len(payload) <= limit:
                self._publisher.put(payload)
                self._sent_s.update(dict.fromkeys(frames, time.monotonic()))
                return
        if len(frames) == 1:
            log.warning(
                "the static transform of %r is not announced: it has %d bytes, and the limit is %d",
                frames[0][:100],
                len(payload),
                limit,
            )
            return
        half = len(frames) // 2
        self._send_chunk(frames[:half], server, announce)
        self._send_chunk(frames[half:], server, announce)


def _follow(announcer_ref: weakref.ref[Announcer], closed: threading.Event) -> None:
    """Inform new servers, until the announcer is closed or collected."""
    while not closed.wait(_PERIOD_S):
        announcer = announcer_ref()
        if announcer is None:
            return
        try:
            announcer.check()
        except ServerUnavailable:  # the connection is closed
            return
        except Exception:  # no error may end announcing
            log.exception("internal error while announcing static transforms")
        del announcer  # or the wait would keep it alive
