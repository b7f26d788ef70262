"""The requests that wait for a worker: bounded in bytes and number, and fair between clients.

Requests wait in lanes. Within a lane the clients take turns, so a client with many requests
delays itself. All lanes share the bounds, for each client and for all together; a request beyond
a bound is refused before any work is spent on it, with the time of the next try.

Thread safety: all methods.
Invariant: a lane holds no client without requests, so `take` is O(1).
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from typing import Final, Generic, Protocol, TypeVar

from zenoh_tf.errors import TransformException

from ..fair_share import FairShare
from ..limits import Limits

#: What a waiting request costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 512
#: How long a refused client waits. A worker does a long request in about that time.
RETRY_AFTER_S: Final = 0.1


class QueuedRequest(Protocol):
    """A request that was received."""

    client: str  # the id of a client that is connected, or empty
    size: int  # bytes of the payload


class QueueShares:
    """What waits in all lanes."""

    def __init__(self, limits: Limits) -> None:
        self.lock = threading.Lock()
        # Guarded by the lock.
        self.count = FairShare(limits, "pending_queries", "client_pending_queries")
        self.bytes = FairShare(limits, "pending_bytes", "client_pending_bytes")

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {"pending_queries": self.count.total, "pending_bytes": self.bytes.total}


R = TypeVar("R", bound=QueuedRequest)


class Lane(Generic[R]):
    """Requests that wait for the same threads, a queue for each client."""

    def __init__(self, shares: QueueShares) -> None:
        self._shares, self._queries, self._sizes = shares, shares.count, shares.bytes
        self._queues: OrderedDict[str, deque[R]] = OrderedDict()
        self._filled = threading.Condition(shares.lock)
        self._waiting = 0  # threads in `wait`
        self._closed = False

    def enqueue(self, request: R) -> TransformException | None:
        """Queue a request, or return why it is refused."""
        client, cost = request.client, request.size + _OVERHEAD_BYTES
        with self._shares.lock:
            if not self._queries.try_take(client, 1):
                return self._queries.refusal(client, 1, RETRY_AFTER_S)
            if not self._sizes.try_take(client, cost):
                self._queries.give_back(client, 1)
                return self._sizes.refusal(client, cost, RETRY_AFTER_S)
            queue = self._queues.get(client)
            if queue is None:
                queue = self._queues[client] = deque()
            queue.append(request)
            if self._waiting:
                self._filled.notify()
            return None

    def take(self) -> R | None:
        """The next request of the client whose turn it is; None if there is none."""
        with self._shares.lock:
            return self._take()

    def wait(self) -> R | None:
        """The same, but waits for a request. None: the lane is closed and empty."""
        with self._shares.lock:
            while (request := self._take()) is None:
                if self._closed:
                    return None
                self._waiting += 1
                self._filled.wait()
                self._waiting -= 1
            return request

    def close(self) -> None:
        """Let `wait` return when the lane is empty."""
        with self._shares.lock:
            self._closed = True
            self._filled.notify_all()

    def _take(self) -> R | None:
        if not self._queues:
            return None
        client, queue = self._queues.popitem(last=False)
        request = queue.popleft()
        if queue:
            self._queues[client] = queue  # to the end: it is the others' turn
        self._queries.give_back(client, 1)
        self._sizes.give_back(client, request.size + _OVERHEAD_BYTES)
        return request
