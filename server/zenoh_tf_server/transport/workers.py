"""The threads that receive and serve queries.

Each request type (`keys.REQUEST_TYPES`) has a Zenoh channel and its own threads. A short request is
served by the thread that receives it: a hand-over to another thread would cost a sequential client
a sixth of its rate. It has one thread more than may serve at once. The thread that receives
a query while all others serve puts it into the lane of the type. So some thread always drains the
channel: a full channel would block Zenoh's receive thread, and with it every client.

Long requests go to lanes with threads of their own, so that short ones never wait behind them:
one lane for long lookups, commits and batches, and one for the infos. `hello` is a type of its own,
and as an info is served like a short request: no work delays it.

How many queries wait, and whose turn it is, is in `lanes`; how replies are sent, in `replies`. No
reply blocks a thread of this module.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any, Final

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import threads
from zenoh_tf._net import keys

from ..requests.handler import UNKNOWN, Handler
from ..security.access_control import KEYED
from .clients import Clients
from .lanes import Admission, Lane, QueuedRequest, QueueShares
from .replies import Replies, Reply

log = logging.getLogger("zenoh_tf.server")

#: Small, because what is in a channel is not counted; a thread always drains it.
_CHANNEL: Final = 8
#: An attachment is a Zenoh id of at most 32 hexadecimal digits, and maybe a word.
_MAX_ATTACHMENT_BYTES: Final = 64
_MAX_SENDERS: Final = 1000
#: A request of up to this size is short: about 15,000 lookups, or 3,000 transforms to store,
#: which take a few milliseconds.
SHORT_BYTES: Final = 256 << 10
#: Types of rare requests: one thread serves each.
_SMALL: Final = ("info", "admin", "hello", "snapshot", "missed")
#: A request with these bytes and no more than `_HELLO_BYTES` is taken for a `hello`.
_HELLO: Final = b"\xa5hello"
_HELLO_BYTES: Final = 64


class Workers:
    """The threads of all request types and lanes."""

    def __init__(
        self,
        service: Handler,
        clients: Clients,
        replies: Replies,
        count: int,
        request_types: Sequence[str] = keys.REQUEST_TYPES,
    ) -> None:
        #: What waits, also of requests that come in other ways.
        self.budget = QueueShares(service.limits)
        service.add_counters(self.budget.counters)
        self._shared = shared = _Shared(service, clients, replies, self.budget)
        long: Lane[zenoh.Query] = Lane(self.budget)
        infos: Lane[zenoh.Query] = Lane(self.budget)
        self._lanes = ((long, count), (infos, 1))
        self._queryables = [
            _Queryable(
                shared,
                request_type,
                1 if request_type in _SMALL else count,
                infos if request_type == "info" else long,
            )
            for request_type in request_types
        ]

    def start(self, session: zenoh.Session, key: Callable[[str], str]) -> None:
        """Receive the queries on the key of each request type."""
        for lane, count in self._lanes:
            for index in range(count):
                self._shared.start(f"lane-{index}", self._shared.serve_lane, lane)
        for queryable in self._queryables:
            queryable.start(session, key)

    def close(self) -> None:
        """Receive no more queries, serve those received, and end the threads."""
        for queryable in self._queryables:
            queryable.undeclare()
        for lane, _ in self._lanes:
            lane.close()
        threads.join(*self._shared.threads)


class _Shared:
    """What all threads share: how a request is served or refused."""

    def __init__(
        self,
        service: Handler,
        clients: Clients,
        replies: Replies,
        budget: QueueShares,
    ) -> None:
        self.service = service
        self.clients = clients
        self.replies = replies
        self.unread = replies.unread
        self.budget = budget
        #: The types whose keys end with the authority or the admin call of the request.
        self.keyed = frozenset(KEYED) if service.guard.keyed else frozenset()
        self.keys: dict[str, zenoh.KeyExpr] = {}
        self.threads: list[threading.Thread] = []
        #: What attachments say: the client's id, and whether it takes parts. Saves decoding.
        self._senders: dict[bytes, tuple[str, bool]] = {}

    def start(self, name: str, work: Callable[..., None], *arguments: object) -> None:
        self.threads.append(threads.start(name, work, *arguments))

    def reply_to(self, query: zenoh.Query, request_type: str, size: int) -> Reply:
        """The ReplyCallback of a query with `size` bytes."""
        # A reply's key must lie within its query's key.
        key = query.key_expr if request_type in self.keyed else self.keys[request_type]
        client, takes_parts = self.sender(query)
        return Reply(query, key, client, takes_parts, size, self.replies)

    def sender(self, query: zenoh.Query) -> tuple[str, bool]:
        """The client that sent a query, and whether it takes parts."""
        attachment = query.attachment
        if attachment is None or len(attachment) > _MAX_ATTACHMENT_BYTES:
            return UNKNOWN, False
        data = attachment.to_bytes()
        known = self._senders.get(data) or self._new_sender(data)
        if known[0] in self.clients.connected:  # the common case
            return known
        return self.clients.known(known[0]), known[1]

    def _new_sender(self, data: bytes) -> tuple[str, bool]:
        client, _, word = data.decode("ascii", "replace").partition(" ")
        known = client, word == keys.TAKES_PARTS
        if len(self._senders) >= _MAX_SENDERS:
            self._senders.clear()
        self._senders[data] = known
        return known

    def serve(self, query: zenoh.Query, request_type: str, data: bytes | None = None) -> None:
        """Run a request and reply to it; never raises. `data` is the payload, if it was read."""
        try:
            if data is None:
                payload = query.payload
                data = payload.to_bytes() if payload is not None else b""
            reply_to = self.reply_to(query, request_type, len(data))
            refusal = self.replies.refusal(reply_to.client) if self.unread.total else None
            if refusal is None:
                chunk = keys.subject(str(query.key_expr)) if request_type in self.keyed else None
                self.service.handle(request_type, data, reply_to, chunk)
            else:
                reply_to(self.service.error(refusal), True)
        except Exception:  # no query may end a worker
            log.exception("internal error while serving %s", request_type)
            query.drop()

    def serve_lane(self, lane: Lane[zenoh.Query]) -> None:
        while (request := lane.wait()) is not None:
            self.serve(request.query, request.request_type)

    def put(
        self, lane: Lane[zenoh.Query], query: zenoh.Query, request_type: str, size: int
    ) -> None:
        """Let a query wait in a lane, or refuse it."""
        refusal: Exception | None
        if size > self.service.limits.message_bytes:
            refusal = self.service.limits.exceeded("message_bytes", size)
        else:
            refusal = lane.put(QueuedRequest(query, request_type, self.sender(query)[0], size))
        if refusal is not None:
            self.reply_to(query, request_type, size)(self.service.error(refusal), True)


class _Queryable(Admission[zenoh.Query]):
    """The channel and the threads of one type of requests."""

    def __init__(
        self, shared: _Shared, request_type: str, count: int, long_lane: Lane[zenoh.Query]
    ) -> None:
        super().__init__(shared.budget, count)
        self._shared = shared
        self._request_type = request_type
        self._count = count
        self._long_lane = long_lane
        self._queryable: zenoh.Queryable[Any] | None = None

    def start(self, session: zenoh.Session, key_of: Callable[[str], str]) -> None:
        key = key_of(self._request_type)
        self._shared.keys[self._request_type] = zenoh.KeyExpr(key)
        channel: FifoChannel[zenoh.Query] = FifoChannel(_CHANNEL)
        served = f"{key}/**" if self._request_type in self._shared.keyed else key
        self._queryable = session.declare_queryable(served, channel, complete=True)
        # Threads receive on the handler: undeclaring a queryable fails while a thread waits on
        # the queryable itself.
        handler: Any = self._queryable.handler
        for index in range(self._count + 1):
            self._shared.start(f"{self._request_type}-{index}", self._work, handler.recv)

    def undeclare(self) -> None:
        if self._queryable is not None:
            self._queryable.undeclare()

    def _work(self, receive: Any) -> None:
        while True:
            try:
                query: zenoh.Query = receive()
            except zenoh.ZError:  # undeclared
                return
            try:
                self._receive(query)
            except Exception:  # no query may end a thread
                log.exception("internal error while receiving on %s", self._request_type)

    def _receive(self, query: zenoh.Query) -> None:
        payload = query.payload
        size = len(payload) if payload is not None else 0
        if size <= SHORT_BYTES:
            data = payload.to_bytes() if payload is not None else b""
            if self._request_type != "info" or (size <= _HELLO_BYTES and _HELLO in data):
                if not self.begin(query, size):
                    self._shared.serve(query, self._request_type, data)
                    while (request := self.end()) is not None:
                        self._shared.serve(request.query, self._request_type)
                return
        self._shared.put(self._long_lane, query, self._request_type, size)

    def _queue(self, query: zenoh.Query, size: int) -> bool:
        self._shared.put(self, query, self._request_type, size)
        return True
