"""Queries: callbacks that only enqueue, and a pool of workers behind one queue.

Why not a Zenoh channel per queryable: a full one would block Zenoh's receive thread, and
with it every client's traffic. Here the callback sees the queue's length and refuses.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh.handlers import Callback

from zenoh_tf import keys

from .outcomes import Answer
from .service import Service

log = logging.getLogger("zenoh_tf.server")

_Job = tuple[str, str, zenoh.Query]  # operation, key of the reply, query


class QueryAnswer:
    """Replies to one query and finishes it: a query that is never finished makes its
    client wait for the whole time-out."""

    __slots__ = ("_key", "_query")

    def __init__(self, query: zenoh.Query, key: str) -> None:
        self._query = query
        self._key = key

    def __call__(self, reply: bytes, failed: bool) -> None:
        with self._query as query:
            try:
                if failed:
                    query.reply_err(reply)
                else:
                    query.reply(self._key, reply)
            except zenoh.ZError as error:  # the client is gone, or gave up
                log.debug("no reply to %s: %s", query.key_expr, error)


class Workers:
    def __init__(self, service: Service, count: int) -> None:
        self._service = service
        self._queue: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._queryables: list[zenoh.Queryable[Any]] = []
        self._threads = [
            threading.Thread(target=self._work, name=f"worker-{index}", daemon=True)
            for index in range(count)
        ]

    def start(self, session: zenoh.Session, tree: str) -> None:
        for thread in self._threads:
            thread.start()
        for operation in keys.OPERATIONS:
            key = keys.operation(tree, operation)
            handler = Callback(self._intake(operation, key), indirect=False)
            self._queryables.append(session.declare_queryable(key, handler, complete=True))

    def close(self) -> None:
        """No more queries; those received are answered, then the workers end."""
        for queryable in self._queryables:
            queryable.undeclare()
        for _ in self._threads:
            self._queue.put(None)
        for thread in self._threads:
            thread.join(timeout=0.5)

    def _intake(self, operation: str, key: str) -> Callable[[zenoh.Query], None]:
        """The callback of one queryable; it runs on Zenoh's receive thread."""
        jobs = self._queue
        service = self._service
        most = service.limits.pending_queries

        def take(query: zenoh.Query) -> None:
            pending = jobs.qsize()
            if pending < most:
                jobs.put((operation, key, query))
            else:
                answer: Answer = QueryAnswer(query, key)
                answer(service.error(service.limits.exceeded("pending_queries", pending + 1)), True)

        return take

    def _work(self) -> None:
        handle = self._service.handle
        while (job := self._queue.get()) is not None:
            operation, key, query = job
            payload = query.payload
            answer = QueryAnswer(query, key)
            try:
                handle(operation, payload.to_bytes() if payload is not None else b"", answer)
            except Exception:  # one query must never end a worker
                log.exception("while answering %s", key)
                query.drop()
