"""The queues between the receiver of puts and the threads that commit them: one per authority.

Start-time fair queueing, which is deficit round robin without the rounds: each queue has a virtual
time, which grows by what its puts cost, and the queue with the least time is served next. A queue
that was empty starts at the time of the queue that is served, so an authority that sends little
waits for one turn of another at most.

Thread safety: none, the caller holds a lock.
Invariants
1. The puts of an authority leave in the order in which they came, one turn at a time: until `done`
   no other turn of that queue is given out.
2. Bytes and puts are bounded, per queue and in all. A full queue drops its oldest dynamic put, as
   the newest one says most about where things are. A static put is never dropped for another one:
   if nothing else can make room, it is refused, and the caller reports that.
3. When a queue has its turn, its stale dynamic puts are dropped, the oldest first, as long as a
   newer one waits behind them, and another queue has stale puts, too. So an authority's newest data
   is never dropped for its age, nor is a burst of one authority.
"""

from __future__ import annotations

import heapq
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Any, Final

from zenoh_tf._core import TransformRows

#: A put costs its bytes, and this for the fixed part of decoding and committing it.
PUT_COST: Final = 4096
#: One turn ends after this cost: about 15 small puts, or one with 700 transforms.
_TURN_COST: Final = 64 << 10
#: A put above this size needs long: another thread than that of the small ones commits it.
LARGE_BYTES: Final = 256 << 10
#: Puts per queue: most are small, and cost more memory than their bytes.
MAX_PUTS: Final = 65_536
#: Authorities with a queue of their own. All others share one.
_MAX_QUEUES: Final = 1024


@dataclass(slots=True, eq=False)
class Put:
    """One message for the tree."""

    authority: str
    static: bool
    payload: Any  # TransformRows; bytes or zenoh.ZBytes to decode; None once it was dropped
    size: int
    arrival_ns: int  # real time
    #: Makes rows of the payload's bytes, if they are not of this project's protocol.
    decode: Callable[[bytes], TransformRows] | None = None
    queued_s: float = 0.0  # monotonic time; a put is stale by how long it has waited
    #: Called once: True after it was committed, False if it was refused. Not if it is dropped.
    done: Callable[[bool], None] | None = None
    #: It is history: never stale, and a turn of its own.
    is_history: bool = False
    #: Another server has admitted its rows: none of them is a stray (core/commits/time_jumps.cpp).
    is_relayed: bool = False

    @classmethod
    def of_rows(cls, authority: str, static: bool, rows: TransformRows, arrival_ns: int) -> Put:
        """A put of rows that another part of the server has decoded."""
        return cls(authority, static, rows, rows.nbytes, arrival_ns)


@dataclass(slots=True, eq=False)
class _Queue:
    authority: str | None  # None: shared by those that have no queue of their own
    start: int = 0  # virtual time
    puts: deque[Put] = field(default_factory=deque)  # also dropped ones, until they come first
    dynamic: deque[Put] = field(default_factory=deque)  # those of `puts` that may be dropped
    bytes: int = 0
    count: int = 0  # without dropped ones
    busy: bool = False  # a turn is given out
    waiting: bool = False  # for its turn, in one of the heaps

    def append(self, put: Put) -> None:
        self.puts.append(put)
        if not put.static:
            self.dynamic.append(put)
        self.bytes += put.size
        self.count += 1

    def has_stale(self, before_s: float) -> bool:
        """True if the oldest dynamic put was queued before this time, and others came later."""
        if len(self.dynamic) < 2:
            return False
        oldest = self.dynamic[0]
        return oldest.queued_s < before_s and not oldest.is_history

    def drop_oldest(self) -> Put | None:
        """Drop the oldest dynamic put; None if there is none."""
        if not self.dynamic:
            return None
        put = self.dynamic.popleft()
        put.payload = None
        self.bytes -= put.size
        self.count -= 1
        self.skip_dropped()
        return put

    def skip_dropped(self) -> None:
        while self.puts and self.puts[0].payload is None:
            self.puts.popleft()

    def popleft(self) -> Put:
        """Remove the first put, which was not dropped."""
        put = self.puts.popleft()
        if not put.static:
            self.dynamic.popleft()
        self.bytes -= put.size
        self.count -= 1
        self.skip_dropped()
        return put


@dataclass(slots=True, eq=False)
class Turn:
    """Puts of one queue, to be committed in this order; then give it to `PutQueues.done`."""

    queue: _Queue
    puts: list[Put]
    cost: int


class PutQueues:
    def __init__(
        self,
        max_queue_bytes: int,
        max_bytes: int,
        max_puts: int = MAX_PUTS,
        max_wait_s: float = inf,
    ) -> None:
        """`max_wait_s`: a dynamic put that has waited for longer is stale."""
        self._max_queue_bytes = max_queue_bytes
        self._max_wait_s = max_wait_s
        self._max_bytes = max_bytes
        self._max_puts = max_puts
        self._queues: dict[str, _Queue] = {}  # with puts or busy, by authority
        self._shared = _Queue(None)
        self._in_shared: Counter[str] = Counter()  # puts by authority
        self._now = 0  # virtual time of the turn given out last
        self._pushed = 0
        # Queues that are not busy and have puts: (virtual time, tie breaker, queue), by the size
        # of the first put. That may be dropped later, so the heap of small ones is checked again.
        self._small: list[tuple[int, int, _Queue]] = []
        self._large: list[tuple[int, int, _Queue]] = []
        self._dropped: list[Put] = []  # as they were stale
        self._last_stale: _Queue | None = None  # the last queue that had stale puts
        self._last_stale_s = self._other_stale_s = -inf  # when that one, and another one, had
        self.bytes = 0
        #: Puts that wait or are in a turn that has not ended.
        self.unfinished = 0

    def add(self, put: Put) -> list[Put]:
        """Queue a put. Return the puts that were dropped for it, and itself if it was refused."""
        queue = self._queue_for(put.authority)
        dropped: list[Put] = []
        while queue.count and not self._fits(queue, put):
            oldest = queue.drop_oldest()
            if oldest is None:
                return [*self._forget(dropped), put]
            dropped.append(oldest)
        self._forget(dropped)
        while self.bytes and self.bytes + put.size > self._max_bytes:
            longest = max((*self._queues.values(), self._shared), key=lambda each: each.bytes)
            oldest = longest.drop_oldest()
            if oldest is None:
                return [*dropped, put]
            dropped += self._forget([oldest])
        queue.append(put)
        self.bytes += put.size
        self.unfinished += 1
        if queue is self._shared:
            self._in_shared[put.authority] += 1
        else:
            self._queues[put.authority] = queue
        if not queue.busy and not queue.waiting:
            queue.start = max(queue.start, self._now)
            self._push(queue)
        return dropped

    def is_full_for(self, authority: str, fraction: float, now_s: float = 0.0) -> bool:
        """True if the queue of an authority uses more than a fraction of its bytes, puts or time to
        wait."""
        queue = self._queue_for(authority)
        return (
            queue.bytes > fraction * self._max_queue_bytes
            or queue.count > fraction * self._max_puts
            or (bool(queue.puts) and queue.puts[0].queued_s < now_s - fraction * self._max_wait_s)
        )

    def take(self, *, small_only: bool, now_s: float = 0.0) -> Turn | None:
        """The next turn; with `small_only` one that needs little time. None if there is none.
        `take_dropped` returns the puts that were dropped before it."""
        queue = self._pop(small_only, now_s)
        if queue is None:
            return None
        puts = [queue.popleft()]
        cost = puts[0].size + PUT_COST
        while (
            queue.puts
            and cost < _TURN_COST
            and queue.puts[0].size <= LARGE_BYTES
            and not (puts[-1].is_history or queue.puts[0].is_history)
        ):
            puts.append(queue.popleft())
            cost += puts[-1].size + PUT_COST
        self._forget(puts)
        self.unfinished += len(puts)  # until `done`
        queue.busy = True
        self._now = max(self._now, queue.start)
        return Turn(queue, puts, cost)

    def take_dropped(self) -> list[Put]:
        """The stale puts that were dropped since the last call."""
        dropped, self._dropped = self._dropped, []
        return dropped

    def done(self, turn: Turn) -> None:
        """End a turn, whose puts are committed."""
        queue = turn.queue
        queue.busy = False
        self.unfinished -= len(turn.puts)
        queue.start += turn.cost
        if queue.puts:
            self._push(queue)
        else:
            self._remove(queue)

    @property
    def has_small(self) -> bool:
        """True if a turn is due that needs little time."""
        return bool(self._small)

    @property
    def has_large(self) -> bool:
        """True if a turn is due that begins with a large put."""
        return bool(self._large)

    def _queue_for(self, authority: str) -> _Queue:
        queue = self._queues.get(authority)
        if queue is not None:
            return queue
        # An authority whose puts wait in the shared queue stays there, or their order would change.
        if len(self._queues) >= _MAX_QUEUES or authority in self._in_shared:
            return self._shared
        return _Queue(authority)

    def _fits(self, queue: _Queue, put: Put) -> bool:
        return queue.bytes + put.size <= self._max_queue_bytes and queue.count < self._max_puts

    def _forget(self, puts: list[Put]) -> list[Put]:
        """Take puts that have left their queue out of the totals."""
        self.unfinished -= len(puts)
        for put in puts:
            self.bytes -= put.size
            if self._in_shared and put.authority in self._in_shared:
                self._in_shared[put.authority] -= 1
                if not self._in_shared[put.authority]:
                    del self._in_shared[put.authority]
        return puts

    def _push(self, queue: _Queue) -> None:
        queue.waiting = True
        self._pushed += 1
        heap = self._small if queue.puts[0].size <= LARGE_BYTES else self._large
        heapq.heappush(heap, (queue.start, self._pushed, queue))

    def _drop_stale(self, queue: _Queue, now_s: float) -> None:
        before_s = now_s - self._max_wait_s
        if not queue.has_stale(before_s):
            return
        if queue is not self._last_stale:
            self._last_stale, self._other_stale_s = queue, self._last_stale_s
        self._last_stale_s = now_s
        while self._other_stale_s >= before_s and queue.has_stale(before_s):
            stale = queue.drop_oldest()
            assert stale is not None
            self._dropped += self._forget([stale])

    def _pop(self, small_only: bool, now_s: float) -> _Queue | None:
        """Remove the queue whose turn it is from its heap, and its stale puts from the queue."""
        while self._small or (self._large and not small_only):
            is_small = bool(self._small) and (
                small_only or not self._large or self._small[0] < self._large[0]
            )
            queue = heapq.heappop(self._small if is_small else self._large)[2]
            queue.waiting = False
            self._drop_stale(queue, now_s)
            if not queue.puts:  # all were dropped for puts of others
                self._remove(queue)
            elif small_only and queue.puts[0].size > LARGE_BYTES:
                self._push(queue)
            else:
                return queue
        return None

    def _remove(self, queue: _Queue) -> None:
        if queue.authority is not None:
            del self._queues[queue.authority]
