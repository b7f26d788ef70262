"""Queries: a bounded Zenoh channel and a pool of threads for each query family.

A pool has one thread more than may serve queries at once. A thread that receives a query while
all others serve puts it into the backlog, or refuses it if the backlog is full. So some thread
always drains the channel: a full channel would block Zenoh's receive thread, and with it every
client. A callback on Zenoh's thread could fill the backlog as well, but costs a sequential client
a sixth of its rate.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from typing import Any

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import keys

from .access_control import KEYED
from .reply_cache import ReplyCallback
from .service import Service

log = logging.getLogger("zenoh_tf.server")

_CHANNEL = 256
#: A Zenoh id has 32 hexadecimal digits.
_MAX_CLIENT_ID_BYTES = 64
#: Families whose requests are short and rare: one thread serves them.
_SMALL = ("info", "admin", "hello")


class QueryReply:
    """The ReplyCallback of one query: sends the reply and finishes the query. The client of a
    query that is never finished waits for its whole time-out."""

    __slots__ = ("_key", "_query")

    def __init__(self, query: zenoh.Query, key: zenoh.KeyExpr) -> None:
        self._query = query
        self._key = key

    @property
    def client(self) -> str:
        """The id of the client that sent the query; empty if it did not say."""
        attachment = self._query.attachment
        if attachment is None or len(attachment) > _MAX_CLIENT_ID_BYTES:
            return ""
        return attachment.to_bytes().decode("ascii", "replace")

    def __call__(self, reply: bytes, failed: bool) -> None:
        query = self._query
        try:
            if failed:
                query.reply_err(reply)
            else:
                query.reply(self._key, reply)
        except zenoh.ZError as error:  # the client has gone, or given up
            log.debug("cannot reply to %s: %s", query.key_expr, error)
        finally:
            query.drop()


class Workers:
    """The pools of all query families."""

    def __init__(self, service: Service, count: int) -> None:
        self._pools = [
            _Pool(service, operation, 1 if operation in _SMALL else count)
            for operation in keys.OPERATIONS
        ]

    def start(self, session: zenoh.Session, tree: str) -> None:
        for pool in self._pools:
            pool.start(session, tree)

    def close(self) -> None:
        """Receive no more queries, serve those received, and end the threads."""
        for pool in self._pools:
            pool.undeclare()
        for pool in self._pools:
            pool.join()


class _Pool:
    def __init__(self, service: Service, operation: str, count: int) -> None:
        self._service = service
        self._operation = operation
        self._count = count
        self._lock = threading.Lock()
        # Guarded by the lock. Invariant: the backlog holds queries only while `count` threads
        # are busy, and each of them looks there before it stops being busy.
        self._busy = 0
        self._backlog: deque[zenoh.Query] = deque()
        self._queryable: zenoh.Queryable[Any] | None = None
        self._threads: list[threading.Thread] = []

    def start(self, session: zenoh.Session, tree: str) -> None:
        key = keys.operation(tree, self._operation)
        self._prefix = f"{key}/"
        keyed = self._service.guard.keyed and self._operation in KEYED
        channel: FifoChannel[zenoh.Query] = FifoChannel(_CHANNEL)
        self._key = zenoh.KeyExpr(key)
        # A reply's key must lie within its query's key. With access rules that names more.
        self._reply_key = None if keyed else self._key
        served = f"{key}/**" if keyed else key
        self._queryable = session.declare_queryable(served, channel, complete=True)
        # Threads receive on the handler: undeclaring a queryable fails while a thread waits on
        # the queryable itself.
        handler: Any = self._queryable.handler
        for index in range(self._count + 1):
            thread = threading.Thread(
                target=self._work,
                args=(handler.recv,),
                name=f"{self._operation}-{index}",
                daemon=True,
            )
            thread.start()
            self._threads.append(thread)

    def undeclare(self) -> None:
        if self._queryable is not None:
            self._queryable.undeclare()

    def join(self) -> None:
        for thread in self._threads:
            thread.join(timeout=0.5)

    def _work(self, receive: Any) -> None:
        while True:
            try:
                query: zenoh.Query = receive()
            except zenoh.ZError:  # undeclared
                return
            if self._admit(query):
                self._serve(query)
                while (waiting := self._next()) is not None:
                    self._serve(waiting)

    def _admit(self, query: zenoh.Query) -> bool:
        """True: this thread is now busy and must serve the query. False: the query was put into
        the backlog, or refused."""
        limits = self._service.limits
        with self._lock:
            if self._busy < self._count:
                self._busy += 1
                return True
            pending = len(self._backlog) + 1
            if pending <= limits.pending_queries:
                self._backlog.append(query)
                return False
        refusal = self._service.error(limits.exceeded("pending_queries", pending))
        QueryReply(query, self._reply_key or query.key_expr)(refusal, True)
        return False

    def _next(self) -> zenoh.Query | None:
        """The next query of the backlog. None: there is none, and this thread is not busy now."""
        with self._lock:
            if self._backlog:
                return self._backlog.popleft()
            self._busy -= 1
            return None

    def _serve(self, query: zenoh.Query) -> None:
        reply_key = self._reply_key
        chunk = None
        if reply_key is None:
            reply_key = query.key_expr
            chunk = str(reply_key).removeprefix(self._prefix)
            chunk = None if "/" in chunk else chunk
        reply_to: ReplyCallback = QueryReply(query, reply_key)
        try:
            payload = query.payload
            data = payload.to_bytes() if payload is not None else b""
            self._service.handle(self._operation, data, reply_to, chunk)
        except Exception:  # no query may end a worker
            log.exception("internal error while serving %s", self._key)
            query.drop()
