"""The requests that wait for a worker: bounded in bytes and number, and fair between clients.

Requests wait in lanes. Within a lane the clients take turns, so a client with many requests
delays itself. All lanes share the bounds, for each client and for all together; a request beyond
a bound is refused before any work is spent on it, and the client is told to come back.

Thread safety: all methods.
Invariant: a lane holds no client without requests, so `take` is O(1).
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import Final

import zenoh

from zenoh_tf.errors import ServerBusy

from .limits import Limits

#: What a waiting request costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 512
#: How long a refused client waits. A worker does a long request in about that time.
RETRY_AFTER_S: Final = 0.1


@dataclass(slots=True)
class Request:
    """A query that was received. `client` is the id of a client that is connected, or empty."""

    query: zenoh.Query
    operation: str
    client: str
    size: int  # bytes of the payload

    @property
    def cost(self) -> int:
        return self.size + _OVERHEAD_BYTES


class Budget:
    """What waits in all lanes, by client and in total."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.lock = threading.Lock()
        # Guarded by the lock.
        self._bytes = 0
        self._client_bytes: dict[str, int] = {}
        self._count = 0
        self._client_count: dict[str, int] = {}

    def add(self, request: Request) -> ServerBusy | None:
        """Count a request, or return why it is refused. Requires the lock."""
        limits, client = self._limits, request.client
        client_bytes = self._client_bytes.get(client, 0)
        client_count = self._client_count.get(client, 0) + 1
        for name, value, held in (
            ("pending_queries", self._count + 1, self._count),
            ("client_pending_queries", client_count, client_count - 1),
            ("pending_bytes", self._bytes + request.cost, self._bytes),
            ("client_pending_bytes", client_bytes + request.cost, client_bytes),
        ):
            # A request that is larger than the limit may wait alone.
            if held and value > getattr(limits, name):
                return busy(limits, name, value)
        self._bytes += request.cost
        self._count += 1
        self._client_bytes[client] = client_bytes + request.cost
        self._client_count[client] = client_count
        return None

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {"pending_queries": self._count, "pending_bytes": self._bytes}

    def remove(self, request: Request) -> None:
        """Count a request no more. Requires the lock."""
        client = request.client
        self._bytes -= request.cost
        self._count -= 1
        self._client_bytes[client] -= request.cost
        self._client_count[client] -= 1
        if not self._client_count[client]:
            del self._client_count[client], self._client_bytes[client]


def busy(limits: Limits, name: str, value: int) -> ServerBusy:
    """The refusal of a request for the limit `name`."""
    error = limits.exceeded(name, value)
    return ServerBusy(
        f"{error}: the request did not run; try again later",
        **error.facts,
        retry_after_s=RETRY_AFTER_S,
    )


class Lane:
    """The requests of one kind that wait, a queue for each client."""

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._queues: OrderedDict[str, deque[Request]] = OrderedDict()
        self._filled = threading.Condition(budget.lock)
        self._closed = False

    def put(self, request: Request) -> ServerBusy | None:
        """Queue a request, or return why it is refused."""
        with self._budget.lock:
            refusal = self._budget.add(request)
            if refusal is None:
                self._queues.setdefault(request.client, deque()).append(request)
                self._filled.notify()
            return refusal

    def take(self) -> Request | None:
        """The next request of the client whose turn it is; None if there is none."""
        if not self._queues:  # saves the lock
            return None
        with self._budget.lock:
            return self._take()

    def wait(self) -> Request | None:
        """The same, but waits for a request. None: the lane is closed and empty."""
        with self._budget.lock:
            while (request := self._take()) is None:
                if self._closed:
                    return None
                self._filled.wait()
            return request

    def close(self) -> None:
        """Let `wait` return when the lane is empty."""
        with self._budget.lock:
            self._closed = True
            self._filled.notify_all()

    def _take(self) -> Request | None:
        if not self._queues:
            return None
        client, queue = self._queues.popitem(last=False)
        request = queue.popleft()
        if queue:
            self._queues[client] = queue  # to the end: it is the others' turn
        self._budget.remove(request)
        return request
