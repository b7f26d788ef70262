"""One thread runs the feeds of all robots, and a few threads connect to those that are away.

Messages wait in a ring for each robot, which the thread empties by turns: a robot that sends much
loses its own messages, and asks for them again, while the others' are applied. Requests to robots
wait without a thread, so one that does not answer costs a timer. What blocks, such as connecting,
runs on the other threads.

Thread safety: all methods.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable, Coroutine, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, TypeVar

import zenoh

from zenoh_tf import threads
from zenoh_tf._net.queries import ReplyParts
from zenoh_tf.errors import TransformException
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.mirrors.shared_bytes import SharedBytes
from zenoh_tf.steps import Ask, LoopSteps, Outcome, Steps

from ..ingest.ingest import Ingest
from ..ingest.put_queues import Put
from ..process.upstream import Upstream
from .shared_streams import SharedStreams

T = TypeVar("T")

log = logging.getLogger("zenoh_tf.server.federation")

#: The rings are emptied so often, and with more robots this much later for each: a look at a ring
#: takes about 1 us.
_LEAST_PERIOD_S: Final = 0.002
_PERIOD_OF_EACH_S: Final = 20e-6
#: Attempts to connect at once. One to a robot that is away takes seconds.
_CONNECTING: Final = 8
#: Puts that are queued at once.
_BATCH_BYTES: Final = 1 << 20


class Pool:
    """The `zenoh_tf.mirrors.source.Runner` of robots, whose sources are `Upstream`."""

    def __init__(self, ingest: Ingest, waiting_bytes: int) -> None:
        """`waiting_bytes`: most bytes of robots' messages that wait, of all together."""
        self._ingest = ingest
        self.room = SharedBytes(waiting_bytes)
        self._puts: list[Put] = []  # of the loop's thread
        self._bytes = 0  # of them
        self._loop = asyncio.new_event_loop()
        self._blocking = ThreadPoolExecutor(_CONNECTING, "robots connect")
        self._feeds: dict[MirrorFeed, None] = {}  # of the loop's thread
        self._streams: list[SharedStreams] = []
        self._next_s = 0.0  # when messages are distributed again
        self._tasks: set[asyncio.Task[None]] = set()  # of the loop's thread; the loop keeps none
        self._thread = threads.start("robots", self._run)

    def add_streams(self, streams: SharedStreams) -> None:
        """Distribute the messages of streams before the feeds are polled, until their session is
        closed."""
        self._streams.append(streams)

    def close(self) -> None:
        """Run nothing any more. Feeds stay as they are."""
        with contextlib.suppress(RuntimeError):  # closed before
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._blocking.shutdown(wait=False, cancel_futures=True)
        threads.join(self._thread)

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a coroutine on the thread."""
        self._loop.call_soon_threadsafe(self._spawn, work)

    async def block(self, call: Callable[..., T], *arguments: object) -> T:
        """The result of a call that blocks."""
        return await self._loop.run_in_executor(self._blocking, call, *arguments)

    # --- what feeds call

    def listen(self, feed: MirrorFeed) -> threading.Thread:
        """Poll a feed until it is closed."""
        self._loop.call_soon_threadsafe(self._feeds.__setitem__, feed, None)
        return self._thread

    def run(self, feed: MirrorFeed, steps: Steps[None]) -> bool:
        """Take the steps of a routine."""
        self._loop.call_soon_threadsafe(_Routine(self._loop, feed, steps).start)
        return True

    def add(self, puts: Iterable[Put], *, wait: bool) -> None:
        """Queue puts after those that were added before, on the pool's thread: once all feeds were
        polled, as each time costs the ingest a turn; with `wait` now, and for a moment until there
        is room."""
        for put in puts:
            self._puts.append(put)
            self._bytes += put.size
            if self._bytes >= _BATCH_BYTES:
                self._queue(wait=wait)
        if wait:
            self._queue(wait=True)

    # --- the thread

    def _queue(self, *, wait: bool) -> None:
        if self._puts:
            puts, self._puts, self._bytes = self._puts, [], 0
            self._ingest.add(puts, wait=wait)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._spawn(self._poll())
        self._loop.run_forever()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("internal error in the federation", exc_info=error)

    async def _poll(self) -> None:
        while True:
            self._distribute()
            for feed in list(self._feeds):
                # A large message takes long: what comes meanwhile must not wait uncounted.
                if time.monotonic() >= self._next_s:
                    self._distribute()
                try:
                    if not feed.poll():
                        del self._feeds[feed]
                except Exception:  # the other robots' messages must be applied
                    log.exception("internal error while a robot's messages were applied")
            self._queue(wait=False)
            await asyncio.sleep(max(_LEAST_PERIOD_S, _PERIOD_OF_EACH_S * len(self._feeds)))

    def _distribute(self) -> None:
        for streams in list(self._streams):
            if not streams.distribute():
                self._streams.remove(streams)
        self._next_s = time.monotonic() + _LEAST_PERIOD_S


class _Routine(LoopSteps):
    """A routine of a feed, whose queries wait without a thread."""

    __slots__ = ("_feed",)

    def __init__(
        self, loop: asyncio.AbstractEventLoop, feed: MirrorFeed, steps: Steps[None]
    ) -> None:
        assert isinstance(feed.source, Upstream)
        super().__init__(_Sender(loop, feed.source), steps)
        self._feed = feed

    def _is_over(self) -> bool:
        return self._feed.closed

    def _done(self, result: None, error: Exception | None) -> None:
        if error is not None:
            log.error("internal error in the federation", exc_info=error)


class _Sender:
    """Sends queries to one robot."""

    def __init__(self, loop: asyncio.AbstractEventLoop, source: Upstream) -> None:
        self.loop = loop
        self._source = source

    def send(self, step: Ask, arrived: Callable[[Outcome], None]) -> None:
        parts = ReplyParts()
        whole: list[bytes] = []

        def replied(reply: zenoh.Reply) -> None:
            if not whole and (data := parts.add(reply)) is not None:
                whole.append(data)

        def ended() -> None:
            outcome = self._source.outcome(step, whole[0] if whole else None)
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self.loop.call_soon_threadsafe(arrived, outcome)

        try:
            self._source.send(step, replied, ended)
        except TransformException as error:
            self.loop.call_soon(arrived, error)
