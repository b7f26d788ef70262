"""Lookups that wait for a transform hold no worker: they are parked until a commit.

Why no commit is missed: the asker notes the commit epoch, looks up, parks, and looks at
the epoch once more; the watching thread waits for any epoch but the one it last served.
A commit before the second look makes the asker try again, one after it wakes the thread.

Thread safety: `ask` from any thread. Deadlines run on the asyncio loop, commits on one
thread, which waits for them only while someone waits: writers pay nothing otherwise.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from zenoh_tf import TransformTree
from zenoh_tf.errors import ServerUnavailable, TransformException

from .limits import Limits
from .outcomes import Answer

#: Tries the lookup: (reply bytes, True if a later commit might still make it succeed).
Attempt = Callable[[], tuple[bytes, bool]]

#: How often the watching thread looks whether it shall end.
_STOP_CHECK_S = 0.2


@dataclass(slots=True, eq=False)
class _Parked:
    attempt: Attempt
    answer: Answer
    reply: bytes  # what the deadline answers: the latest attempt's errors
    timer: asyncio.TimerHandle | None = None


class Waiters:
    def __init__(
        self, tree: TransformTree, limits: Limits, loop: asyncio.AbstractEventLoop
    ) -> None:
        self._tree = tree
        self._limits = limits
        self._loop = loop
        self._lock = threading.Lock()
        self._someone = threading.Condition(self._lock)
        self._parked: set[_Parked] = set()
        self._stopping = False
        self._thread = threading.Thread(target=self._watch, name="waiters", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        return len(self._parked)

    def ask(self, attempt: Attempt, timeout_s: float, answer: Answer) -> None:
        """Answer now if possible, else as soon as a commit allows, else at the deadline."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            epoch = self._tree.commit_epoch()
            reply, worth_waiting = attempt()
            left_s = deadline_s - time.monotonic()
            if not worth_waiting or left_s <= 0:
                answer(reply, False)
                return
            parked = _Parked(attempt, answer, reply)
            self._park(parked)
            if self._tree.commit_epoch() == epoch:
                self._loop.call_soon_threadsafe(self._start_timer, parked, left_s)
                return
            if not self._take(parked):  # the watching thread was quicker and answered
                return

    def close(self, error_reply: Callable[[TransformException], bytes]) -> None:
        """Answer whoever still waits with ServerUnavailable; end the thread."""
        with self._lock:
            self._stopping = True
            parked, self._parked = self._parked, set()
            self._someone.notify_all()
        for waiter in parked:
            waiter.answer(error_reply(ServerUnavailable("the server is stopping")), True)
        self._thread.join(timeout=2 * _STOP_CHECK_S)

    def _park(self, parked: _Parked) -> None:
        with self._lock:
            if self._stopping:
                raise ServerUnavailable("the server is stopping")
            self._limits.check("waiters", len(self._parked) + 1)
            self._parked.add(parked)
            self._someone.notify()

    def _take(self, parked: _Parked) -> bool:
        """True for exactly one caller, which then answers."""
        with self._lock:
            if parked not in self._parked:
                return False
            self._parked.remove(parked)
        self._loop.call_soon_threadsafe(self._cancel_timer, parked)
        return True

    def _start_timer(self, parked: _Parked, left_s: float) -> None:
        if parked in self._parked:
            parked.timer = self._loop.call_later(left_s, self._expire, parked)

    @staticmethod
    def _cancel_timer(parked: _Parked) -> None:
        if parked.timer is not None:
            parked.timer.cancel()

    def _expire(self, parked: _Parked) -> None:
        if self._take(parked):
            parked.answer(parked.reply, False)

    def _watch(self) -> None:
        seen = self._tree.commit_epoch()
        while True:
            with self._lock:
                self._someone.wait_for(lambda: self._parked or self._stopping)
                if self._stopping:
                    return
            epoch = self._tree.wait_commit(seen, _STOP_CHECK_S)
            if epoch != seen:
                seen = epoch
                self._retry()

    def _retry(self) -> None:
        with self._lock:
            parked = list(self._parked)
        for waiter in parked:
            waiter.reply, worth_waiting = waiter.attempt()
            if not worth_waiting and self._take(waiter):
                waiter.answer(waiter.reply, False)
