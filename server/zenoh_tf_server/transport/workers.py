"""The threads that receive and serve queries.

Each request type (`keys.REQUEST_TYPES`) has a Zenoh channel and its own threads. A short request is
served by the thread that receives it: a hand-over to another thread would cost a sequential client
a sixth of its rate. It has one thread more than may serve at once. The thread that receives
a query while all others serve puts it into the lane of the type. So some thread always drains the
channel: a full channel would block Zenoh's receive thread, and with it every client.

Long requests go to lanes with threads of their own, so that short ones never wait behind them:
one lane for long lookups, commits and batches, and one for the infos. `hello` is a type of its own,
and as an info is served like a short request: no work delays it.

How many queries wait, and whose turn it is, is in `lanes`; how replies are sent, in
`zenoh_tf._zenoh.replies`. No reply blocks a thread of this module.
"""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable
from typing import Any, Final

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import threads
from zenoh_tf._net import keys
from zenoh_tf._zenoh.replies import Replies, Reply

from ..requests.handler import UNKNOWN, Handler
from ..security.access_control import KEYED
from .clients import Clients
from .lanes import RETRY_AFTER_S, Lane, QueueShares

log = logging.getLogger("zenoh_tf.server")

#: Small, because what is in a channel is not counted; a thread always drains it.
_CHANNEL: Final = 8
#: An attachment is a Zenoh id of at most 32 hexadecimal digits, and maybe a word.
_MAX_ATTACHMENT_BYTES: Final = 64
_MAX_SENDERS: Final = 1000
#: A request of up to this size is short: about 15,000 lookups, or 3,000 transforms to store,
#: of a few milliseconds.
SHORT_BYTES: Final = 256 << 10
#: Types of rare requests: one thread serves each.
_SMALL: Final = ("info", "admin", "hello", "snapshot", "missed")
#: A request with these bytes and no more than `_HELLO_BYTES` is treated as a `hello`.
_HELLO: Final = b"\xa5hello"
_HELLO_BYTES: Final = 64


@functools.lru_cache(_MAX_SENDERS)
def _sender_of(attachment: bytes) -> tuple[str, bool]:
    """What an attachment says: the client's id, and whether it accepts parts."""
    client, _, word = attachment.decode("ascii", "replace").partition(" ")
    return client, word == keys.TAKES_PARTS


class Workers:
    """The threads of all request types and lanes."""

    def __init__(
        self,
        service: Handler,
        clients: Clients,
        replies: Replies,
        count: int,
    ) -> None:
        #: What waits, also of requests that do not come as queries.
        self.shares = QueueShares(service.limits)
        service.add_counters(self.shares.counters)
        self._service = service
        self._clients = clients
        self._replies = replies
        #: The types whose keys end with the authority or the admin call of the request.
        self.keyed = frozenset(KEYED) if service.guard.keyed else frozenset()
        #: By request type.
        self.keys: dict[str, zenoh.KeyExpr] = {}
        self._threads: list[threading.Thread] = []
        long: Lane[Reply] = Lane(self.shares)
        infos: Lane[Reply] = Lane(self.shares)
        self._lanes = ((long, count), (infos, 1))
        self._queryables = [
            _Queryable(
                self,
                request_type,
                1 if request_type in _SMALL else count,
                infos if request_type == "info" else long,
            )
            for request_type in keys.REQUEST_TYPES
        ]

    def start(self, session: zenoh.Session, key: Callable[[str], str]) -> None:
        """Receive the queries on the key of each request type."""
        for lane, count in self._lanes:
            for index in range(count):
                self.start_thread(f"lane-{index}", self._serve_lane, lane)
        for queryable in self._queryables:
            queryable.start(session, key)

    def start_thread(self, name: str, work: Callable[..., None], *arguments: object) -> None:
        """Start a thread that ends after `close`."""
        self._threads.append(threads.start(name, work, *arguments))

    def close(self) -> None:
        """Receive no more queries, serve those received, and end the threads."""
        for queryable in self._queryables:
            queryable.undeclare()
        for lane, _ in self._lanes:
            lane.close()
        threads.join(*self._threads)

    def reply_to(self, query: zenoh.Query, request_type: str, size: int) -> Reply:
        """The ReplyCallback of a query with `size` bytes."""
        client, in_parts = UNKNOWN, False
        attachment = query.attachment
        if attachment is not None and len(attachment) <= _MAX_ATTACHMENT_BYTES:
            client, in_parts = _sender_of(attachment.to_bytes())
            if client not in self._clients.connected:
                client = self._clients.known(client)
        # A reply's key must lie within its query's key.
        key = query.key_expr if request_type in self.keyed else self.keys[request_type]
        return Reply(query, request_type, size, key, client, in_parts, self._replies)

    def serve(self, reply_to: Reply, data: bytes | None = None) -> None:
        """Run a request and reply to it; never raises. `data` is the payload, if it was read."""
        query, request_type = reply_to.query, reply_to.request_type
        try:
            if data is None:
                payload = query.payload
                data = payload.to_bytes() if payload is not None else b""
            if self._replies.unread.total:  # not the common case
                refusal = self._replies.refusal(reply_to.client, RETRY_AFTER_S)
                if refusal is not None:
                    reply_to(self._service.error(refusal), True)
                    return
            chunk = keys.subject(str(query.key_expr)) if request_type in self.keyed else None
            self._service.handle(request_type, data, reply_to, chunk)
        except Exception:  # no query may end a worker
            log.exception("internal error while serving %s", request_type)
            query.drop()

    def count_thread(self, request_type: str) -> None:
        """Begin to count the requests that the calling thread serves."""
        self._service.requests.add_thread(request_type)

    def _serve_lane(self, lane: Lane[Reply]) -> None:
        while (request := lane.wait()) is not None:
            self.serve(request)

    def enqueue(self, lane: Lane[Reply], reply_to: Reply) -> None:
        """Let a query wait in a lane, or refuse it."""
        refusal: Exception | None
        if reply_to.size > self._service.limits.message_bytes:
            refusal = self._service.limits.exceeded("message_bytes", reply_to.size)
        else:
            refusal = lane.enqueue(reply_to)
        if refusal is not None:
            reply_to(self._service.error(refusal), True)


def _is_hello(data: bytes) -> bool:
    return len(data) <= _HELLO_BYTES and _HELLO in data


class _Queryable(Lane[Reply]):
    """The channel and the threads of one type of requests. Some requests are served at once; others
    wait in the lane, or are refused.

    Invariant: requests wait only while no place is free. A thread takes a place or queues, and then
    takes from the queue or frees the place, under one lock, so no request stays behind. That lock
    is taken before that of the shares.
    """

    def __init__(
        self, workers: Workers, request_type: str, count: int, long_lane: Lane[Reply]
    ) -> None:
        super().__init__(workers.shares)
        self._lock = threading.Lock()
        self._free = count  # places, guarded by the lock
        self._workers = workers
        self._request_type = request_type
        self._is_info = request_type == "info"
        self._count = count
        self._long_lane = long_lane
        self._queryable: zenoh.Queryable[Any] | None = None

    def start(self, session: zenoh.Session, key_of: Callable[[str], str]) -> None:
        key = key_of(self._request_type)
        self._workers.keys[self._request_type] = zenoh.KeyExpr(key)
        channel: FifoChannel[zenoh.Query] = FifoChannel(_CHANNEL)
        served = f"{key}/**" if self._request_type in self._workers.keyed else key
        self._queryable = session.declare_queryable(served, channel, complete=True)
        # Threads receive on the handler: undeclaring a queryable fails while a thread waits on
        # the queryable itself.
        handler: Any = self._queryable.handler
        for index in range(self._count + 1):
            self._workers.start_thread(f"{self._request_type}-{index}", self._work, handler.recv)

    def undeclare(self) -> None:
        if self._queryable is not None:
            self._queryable.undeclare()

    def _work(self, receive: Any) -> None:
        workers = self._workers
        workers.count_thread(self._request_type)
        request: Reply | None = None
        while True:
            try:
                query: zenoh.Query = receive()
            except zenoh.ZError:  # undeclared
                return
            try:
                payload = query.payload
                size = len(payload) if payload is not None else 0
                data = payload.to_bytes() if payload is not None and size <= SHORT_BYTES else b""
                request = workers.reply_to(query, self._request_type, size)
                if size > SHORT_BYTES or (self._is_info and not _is_hello(data)):
                    workers.enqueue(self._long_lane, request)
                    continue
                with self._lock:
                    if not self._free:
                        workers.enqueue(self, request)
                        continue
                    self._free -= 1
                workers.serve(request, data)
                while True:
                    with self._lock:
                        request = self.take() if self._queues else None
                        if request is None:
                            self._free += 1
                            break
                    workers.serve(request)
            except Exception:  # no query may end a thread
                log.exception("internal error while receiving on %s", self._request_type)
            finally:  # keep nothing while the thread waits for the next query
                payload, data, request = None, b"", None
