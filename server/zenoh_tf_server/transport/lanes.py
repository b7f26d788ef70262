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
from typing import Any, Final, Generic, TypeVar

from zenoh_tf.errors import ServerBusy

from ..limits import Limits

#: What waits: a query, or something else that stands for a request.
Q = TypeVar("Q")

#: What a waiting request costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 512
#: How long a refused client waits. A worker does a long request in about that time.
RETRY_AFTER_S: Final = 0.1


@dataclass(slots=True)
class Request(Generic[Q]):
    """A query that was received. `client` is the id of a client that is connected, or empty."""

    query: Q
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
        self._count = 0
        self._clients: dict[str, list[int]] = {}  # client: bytes, number

    def add(self, request: Request[Any]) -> ServerBusy | None:
        """Count a request, or return why it is refused. Requires the lock."""
        limits, cost = self._limits, request.cost
        used = self._clients.get(request.client)
        if used is None:
            used = [0, 0]
        # A request that is larger than a limit may wait alone.
        if self._count and self._count >= limits.pending_queries:
            return busy(limits, "pending_queries", self._count + 1)
        if used[1] and used[1] >= limits.client_pending_queries:
            return busy(limits, "client_pending_queries", used[1] + 1)
        if self._bytes and self._bytes + cost > limits.pending_bytes:
            return busy(limits, "pending_bytes", self._bytes + cost)
        if used[0] and used[0] + cost > limits.client_pending_bytes:
            return busy(limits, "client_pending_bytes", used[0] + cost)
        self._bytes += cost
        self._count += 1
        used[0] += cost
        used[1] += 1
        self._clients[request.client] = used
        return None

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {"pending_queries": self._count, "pending_bytes": self._bytes}

    def remove(self, request: Request[Any]) -> None:
        """Count a request no more. Requires the lock."""
        cost = request.cost
        used = self._clients[request.client]
        self._bytes -= cost
        self._count -= 1
        used[0] -= cost
        used[1] -= 1
        if not used[1]:
            del self._clients[request.client]


def busy(limits: Limits, name: str, value: int) -> ServerBusy:
    """The refusal of a request for the limit `name`."""
    error = limits.exceeded(name, value)
    return ServerBusy(
        f"{error}: the request did not run; try again later",
        **error.facts,
        retry_after_s=RETRY_AFTER_S,
    )


class Lane(Generic[Q]):
    """The requests of one kind that wait, a queue for each client."""

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._queues: OrderedDict[str, deque[Request[Q]]] = OrderedDict()
        self._filled = threading.Condition(budget.lock)
        self._waiting = 0  # threads in `wait`
        self._closed = False

    def put(self, request: Request[Q]) -> ServerBusy | None:
        """Queue a request, or return why it is refused."""
        with self._budget.lock:
            refusal = self._budget.add(request)
            if refusal is None:
                queue = self._queues.get(request.client)
                if queue is None:
                    queue = self._queues[request.client] = deque()
                queue.append(request)
                if self._waiting:
                    self._filled.notify()
            return refusal

    def take(self) -> Request[Q] | None:
        """The next request of the client whose turn it is; None if there is none."""
        with self._budget.lock:
            return self._take()

    def wait(self) -> Request[Q] | None:
        """The same, but waits for a request. None: the lane is closed and empty."""
        with self._budget.lock:
            while (request := self._take()) is None:
                if self._closed:
                    return None
                self._waiting += 1
                self._filled.wait()
                self._waiting -= 1
            return request

    def close(self) -> None:
        """Let `wait` return when the lane is empty."""
        with self._budget.lock:
            self._closed = True
            self._filled.notify_all()

    def _take(self) -> Request[Q] | None:
        if not self._queues:
            return None
        client, queue = self._queues.popitem(last=False)
        request = queue.popleft()
        if queue:
            self._queues[client] = queue  # to the end: it is the others' turn
        self._budget.remove(request)
        return request


class Admission(Lane[Q]):
    """Lets some requests be served at once; others wait in the lane, or are refused.

    Invariant: requests wait only while no place is free. `begin` takes a place or queues, and
    `end` takes from the queue or frees the place, under one lock, so no request stays behind. That
    lock is taken before the budget's.
    """

    def __init__(self, budget: Budget, places: int) -> None:
        super().__init__(budget)
        self._lock = threading.Lock()
        self._free = places  # guarded by the lock

    def begin(self, request: Any, size: int) -> Any:
        """None: the request, of so many bytes, is served now, until `end`. Else what `_queue` says,
        which puts it into the lane, or refuses it."""
        with self._lock:
            if not self._free:
                return self._queue(request, size)
            self._free -= 1
            return None

    def end(self) -> Request[Q] | None:
        """End a request. Returns the one that is served in its place, if `_resume` has not."""
        with self._lock:
            if self._queues and (request := self.take()) is not None:
                return self._resume(request)
            self._free += 1
            return None

    def _queue(self, request: Any, size: int) -> Any:
        raise NotImplementedError

    def _resume(self, request: Request[Q]) -> Request[Q] | None:
        return request
