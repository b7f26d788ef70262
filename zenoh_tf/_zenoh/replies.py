"""Sends replies, so that a client that does not read delays nobody else.

Zenoh would block the thread that replies to it, and its routing tables (eclipse-zenoh/zenoh#1876).

No thread ever waits for a client. Each client has an outbox with a credit: how many bytes its
link accepts now without blocking (`outbox_links`). A worker sends a reply itself as long as the
credit lasts. Else the reply waits in the outbox, and the sender thread continues when the link has
room; it waits for all full links at once. A client that can join parts gets a long reply in parts
as large as the credit. What waits in an outbox is bounded in bytes: the client's new requests are
refused (`refusal`), and a client that reads nothing for a while loses its connection, alone.

Where a link's room is not known, a thread of the client's own sends what is beyond the credit,
and may block in Zenoh.

Thread safety: all methods.
Invariant: an outbox is busy while replies wait in it, and one thread owns a busy outbox: it sends
them, or hands the outbox over. Replies only overtake others of the same client if nothing waits.
"""

from __future__ import annotations

import contextlib
import logging
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import zenoh

from .. import threads
from ..errors import LimitExceeded, TransformException
from .outbox_links import BROKEN, UNCHECKED_ROOM, WHOLE_ROOM, OutboxLinks
from .server_parts import UnreadBytes

log = logging.getLogger("zenoh_tf.server")

#: What a reply costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 512
#: The sender thread sends at most this many replies and parts of one client before the next.
_AT_ONCE: Final = 32
#: A client that reads nothing of what waits for it for this long loses its connection. Zenoh
#: gives a silent peer as long.
_CUT_OFF_S: Final = 10.0
#: How often links are asked that no poll can wait for.
_ASK_AGAIN_MS: Final = 10
_POLL_MS: Final = 1000
#: A send that takes less has not waited for the link.
_PROMPT_S: Final = 0.002


@dataclass(slots=True, eq=False)
class Reply:
    """One query and its reply, of which it is the ReplyCallback, and how much of it is sent."""

    query: zenoh.Query
    request_type: str
    size: int  # bytes of the query's payload
    key: zenoh.KeyExpr  # of the reply
    client: str  # the id of a client that is connected, or empty
    in_parts: bool  # the client joins a reply that comes in parts
    replies: Replies
    data: bytes = b""
    failed: bool = False
    _start: int = 0  # how many bytes are sent

    def __call__(self, reply: bytes, failed: bool) -> None:
        """Send the reply's bytes now or later, without blocking. `failed`: they are an error."""
        replies = self.replies
        if len(reply) > WHOLE_ROOM and not self.in_parts and not failed:
            reply, failed = replies.too_long(len(reply)), True
        self.data, self.failed = reply, failed
        self.in_parts &= not failed
        size = len(reply) + _OVERHEAD_BYTES
        now = False
        outbox = replies.outboxes.get(self.client)
        if outbox is not None:
            with outbox.lock:
                if not outbox.busy and outbox.credit >= size:  # the common case
                    outbox.credit -= size
                    now = True
        if not now and not replies.admit(self):
            return
        query = self.query
        try:
            if failed:
                query.reply_err(reply)
            else:
                query.reply(self.key, reply)
        except zenoh.ZError as error:  # the client has gone, or given up
            log.debug("cannot reply to %s: %s", query.key_expr, error)
        query.drop()

    @property
    def cost(self) -> int:
        """What it costs to keep. The query keeps the request's bytes until it is dropped."""
        return len(self.data) + self.size + _OVERHEAD_BYTES

    def left(self) -> int:
        """How many bytes are not sent yet, with the message's own."""
        return len(self.data) - self._start + _OVERHEAD_BYTES

    def send(self, room: int) -> bool:
        """Send the reply, or as much of it as there is room for if it may come in parts. True:
        that was the last, and the query is finished. The client of a query that is never finished
        waits for its whole time-out."""
        query, key, data, start = self.query, self.key, self.data, self._start
        try:
            if self.failed:
                query.reply_err(data)
            elif start == 0 and (not self.in_parts or self.left() <= room):
                query.reply(key, data)
            else:
                data = data[start : start + room - _OVERHEAD_BYTES]
                query.reply(key, data, attachment=str(len(self.data)).encode())
            self._start = start + len(data)
        except zenoh.ZError as error:  # the client has gone, or given up
            log.debug("cannot reply to %s: %s", query.key_expr, error)
            self._start = len(self.data)
        if self._start < len(self.data):
            return False
        query.drop()
        return True


class _Outbox:
    """The replies to one client that are not sent yet."""

    __slots__ = ("busy", "client", "credit", "lock", "queue", "stuck_since_s")

    def __init__(self, client: str) -> None:
        self.client = client
        self.lock = threading.Lock()
        # Guarded by the lock.
        self.busy = False
        self.queue: deque[Reply] = deque()
        self.credit = UNCHECKED_ROOM
        # The sender thread's.
        self.stuck_since_s = 0.0


class Replies:
    """All outboxes, and the sender thread."""

    def __init__(
        self,
        links: OutboxLinks,
        unread: UnreadBytes,
        cut_off_bytes: int,
        encode: Callable[[Exception], bytes],
    ) -> None:
        """`unread`: what waits; nothing waits for any client while its total is 0. A client for
        which more than `cut_off_bytes` wait, and which asks on, loses its connection. `encode`
        gives the bytes of an error reply."""
        self._links = links
        self._encode = encode
        self._cut_off_bytes = cut_off_bytes
        self._lock = threading.Lock()
        self.outboxes: dict[str, _Outbox] = {}
        self.unread = unread
        self._cut_off = 0  # clients whose connections were closed
        self._handed_over: deque[_Outbox] = deque()
        self._closing = False
        self._woken, self._wake = socket.socketpair()
        self._wake.setblocking(False)
        self._thread = threads.start("replies", self._serve)

    def close(self) -> None:
        """End the thread. Clients that have not read their replies lose the connection, because
        Zenoh would wait for them."""
        self._closing = True
        self._wake_up()
        threads.join(self._thread)
        for outbox in list(self.outboxes.values()):
            if outbox.busy:
                self._links.cut_full(outbox.client)
        if not self._thread.is_alive():
            self._woken.close()
            self._wake.close()

    def admit(self, reply: Reply) -> bool:
        """Whether a reply may be sent now; if not, it is sent later. Never blocks."""
        outbox = self.outboxes.get(reply.client) or self._new_outbox(reply.client)
        size = len(reply.data) + _OVERHEAD_BYTES
        with outbox.lock:
            if not outbox.busy and self._spend(outbox, size, reply):
                return True
            self._hold(outbox, reply)
            hand_over = not outbox.busy
            outbox.busy = True
        if hand_over:
            self._handed_over.append(outbox)
            self._wake_up()
        return False

    def refusal(self, client: str, retry_after_s: float) -> TransformException | None:
        """Why a new request of the client must be refused: so many bytes of replies wait for the
        client, or for all. None: nothing stands against it, as long as `unread.total` is 0."""
        with self._lock:
            held = self.unread.held(client)
            if not held or self.unread.try_take(client, 0):
                return None
            refusal = self.unread.refusal(client, 0, retry_after_s)
        if held > self._cut_off_bytes:
            # It continues to ask, and even the refusals are not read.
            self._cut_off += self._links.cut_full(client)
        return refusal

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {"unread_reply_bytes": self.unread.total, "clients_cut_off": self._cut_off}

    def too_long(self, size: int) -> bytes:
        """The reply in place of one that is too long for a client that accepts no parts."""
        error = LimitExceeded(
            f"the request has run, but its reply of {size:,} bytes is too long for a client that "
            f"accepts no parts: the limit is {WHOLE_ROOM:,} bytes; ask for less, or in parts",
            field="whole_reply_bytes",
            limit=WHOLE_ROOM,
            value=size,
        )
        return self._encode(error)

    def forget(self, client: str) -> None:
        """Forget a client that is gone, unless replies to it are still to be finished."""
        with self._lock:
            outbox = self.outboxes.get(client)
            if outbox is not None and not outbox.busy:
                del self.outboxes[client]

    def _wake_up(self) -> None:
        with contextlib.suppress(OSError):  # it is to wake up already, or closed
            self._wake.send(b"x")

    def _new_outbox(self, client: str) -> _Outbox:
        if self._links.is_gone(client):  # a late reply, after which nobody would forget it
            return _Outbox(client)
        with self._lock:
            return self.outboxes.setdefault(client, _Outbox(client))

    def _spend(self, outbox: _Outbox, size: int, reply: Reply) -> bool:
        """Spend the credit for sending `size` bytes. Requires the outbox's lock."""
        if outbox.credit < size:
            room = self._links.room(outbox.client)
            if room is not None:
                outbox.credit = room
            if outbox.credit < size:
                # What cannot be sent in parts is sent when nothing is before it.
                return (
                    room is not None
                    and not reply.in_parts
                    and size <= WHOLE_ROOM
                    and self._links.is_empty(outbox.client)
                )
        outbox.credit -= size
        return True

    def _hold(self, outbox: _Outbox, reply: Reply) -> None:
        """Queue a reply. Requires the outbox's lock."""
        outbox.queue.append(reply)
        with self._lock:
            self.unread.take_unchecked(outbox.client, reply.cost)

    # --- the sender thread

    def _serve(self) -> None:
        stuck: deque[_Outbox] = deque()
        while not self._closing:
            try:
                self._wait(stuck)
                while self._handed_over:
                    stuck.append(self._handed_over.popleft())
                for _ in range(len(stuck)):
                    outbox = stuck.popleft()
                    if not self._resume(outbox):
                        stuck.append(outbox)
            except Exception:  # nothing may end the thread
                log.exception("internal error while sending replies")

    def _resume(self, outbox: _Outbox) -> bool:
        """Continue to send. True: the outbox is done, or another thread's."""
        if self._links.is_blind(outbox.client):
            threads.start("reply", self._send_blindly, outbox)
            return True
        progress = False
        for _ in range(_AT_ONCE):
            if not outbox.queue:
                break
            if not self._send_first(outbox):
                break
            progress = True
        if self._is_done(outbox):
            return True
        now_s = time.monotonic()
        if progress or not outbox.stuck_since_s:
            outbox.stuck_since_s = now_s
        elif now_s - outbox.stuck_since_s > _CUT_OFF_S:
            outbox.stuck_since_s = now_s
            if self._links.cut_full(outbox.client):
                self._cut_off += 1
                log.warning(
                    "client %s has read nothing for %g s: closed its connection",
                    outbox.client or "(unknown)",
                    _CUT_OFF_S,
                )
        return False

    def _send_first(self, outbox: _Outbox) -> bool:
        """Send the outbox's first reply, or a part of it. False: there is no room."""
        reply = outbox.queue[0]
        size = reply.left()
        with outbox.lock:
            if not self._spend(outbox, size, reply):
                size, outbox.credit = outbox.credit, 0
                if not reply.in_parts or size < UNCHECKED_ROOM:
                    return False
        if reply.send(size):
            self._remove_first(outbox)
        return True

    def _remove_first(self, outbox: _Outbox) -> None:
        with outbox.lock:
            reply = outbox.queue.popleft()
        with self._lock:
            self.unread.give_back(outbox.client, reply.cost)

    def _is_done(self, outbox: _Outbox) -> bool:
        with outbox.lock:
            if outbox.queue:
                return False
            outbox.busy = False
            outbox.stuck_since_s = 0.0
        if self._links.is_gone(outbox.client):
            self.forget(outbox.client)
        return True

    def _send_blindly(self, outbox: _Outbox) -> None:
        """Send all, and block where Zenoh blocks. On a thread of the outbox's own."""
        while not self._is_done(outbox):
            start_s = time.monotonic()
            while not outbox.queue[0].send(UNCHECKED_ROOM):
                pass
            self._remove_first(outbox)
            if time.monotonic() - start_s < _PROMPT_S:  # the link is not full
                outbox.credit = UNCHECKED_ROOM

    def _wait(self, stuck: deque[_Outbox]) -> None:
        """Wait until an outbox is handed over, or the link of a stuck one may have room."""
        poll = select.poll()
        poll.register(self._woken, select.POLLIN)
        timeout_ms = _POLL_MS
        for outbox in stuck:
            full = self._links.full_link(outbox.client)
            if full is None and outbox.queue[0].in_parts:
                timeout_ms = 0
            elif full is None or full == BROKEN:
                timeout_ms = min(timeout_ms, _ASK_AGAIN_MS)
            else:
                poll.register(full, select.POLLOUT)
        if self._handed_over:
            timeout_ms = 0
        for fd, _ in poll.poll(timeout_ms):
            if fd == self._woken.fileno():
                self._woken.recv(4096)
