"""`Gate`: holds sensor data until its transform exists."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import AsyncIterator, Iterator
from typing import TYPE_CHECKING, Any, Protocol

from zenoh_tf import threads
from zenoh_tf._core import StampedTransform
from zenoh_tf.array import TransformArray
from zenoh_tf.errors import ServiceException, TimeoutException, TransformException
from zenoh_tf.gap_limit import max_gap_ns
from zenoh_tf.gates.queue import (
    EARLY_S,
    PAUSE_S,
    FirstError,
    GateQueue,
    Held,
    OnDrop,
    Passed,
    check_item,
    portions,
)
from zenoh_tf.loop_waits import LoopWaits

if TYPE_CHECKING:
    from typing_extensions import Self

log = logging.getLogger("zenoh_tf")


class GateLookups(Protocol):
    """What a gate looks up in: a tree, a client or a mirror."""

    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int,
        timeout_s: float,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform: ...
    def lookup_transforms(
        self,
        targets: str,
        sources: str,
        stamps_ns: list[int],
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray: ...


class Gate:
    """Holds items until their transforms exist; made by `gate` of a tree or a client.

    Put images, clouds or detections in as they arrive, each with its frame and stamp. The gate
    hands each over together with `X_target_frame` at its stamp, from the one lookup that found it:
    so no later lookup can fail. What it cannot hand over it drops, and says why. A lookup that
    waits costs nothing until a write may have made it possible, and items of one frame share it.
    A context manager, which closes itself at the end.

    Thread safety: all methods. An event loop iterates with ``async for``; nothing else here waits.

    Example:
        ``for image, transform in gate: show(image, transform.transform)``

    Attributes:
        target: The frame to express coordinates in.
    """

    def __init__(
        self,
        source: GateLookups,
        target: str,
        queue_size: int,
        timeout_s: float,
        on_drop: OnDrop | None,
        max_gap_s: float | None = None,
    ) -> None:
        """Use `TransformTree.gate` or `TransformClient.gate` instead.

        Raises:
            InvalidArgumentException: An argument is invalid.
        """
        check_item(target, 0)
        max_gap_ns(max_gap_s)  # raises
        self.target = target
        self._source = source
        self._on_drop = on_drop
        self._max_gap_s = max_gap_s
        self._queue: GateQueue[Any] = GateQueue(target, queue_size, timeout_s)
        self._reports = FirstError(log)
        self._lock = threading.Condition()
        self._closed = threading.Event()
        self._loops = LoopWaits()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Passed[Any]]:
        """Iterate over items and their transforms, until the gate is closed."""
        while (passed := self._next(None)) is not None:
            yield passed

    def __aiter__(self) -> AsyncIterator[Passed[Any]]:
        """Iterate on an event loop, until the gate is closed."""
        return self._loops.events(lambda: self._next(0.0), lambda: self._queue.closed)

    def put(self, item: Any, frame: str, stamp_ns: int) -> None:
        """Hold an item until its transform exists. Never waits.

        Args:
            item: Anything.
            frame: The frame in which it was measured.
            stamp_ns: When, in nanoseconds.

        Raises:
            InvalidArgumentException: The name or the stamp is invalid.
            RuntimeError: The system has no room for a thread. The item is not held.
        """
        check_item(frame, stamp_ns)
        with self._lock:
            # It begins under the lock: else others might put, and rely on it.
            if self._queue.put(item, frame, stamp_ns, time.monotonic()):
                try:
                    self._begin(frame)
                except BaseException:
                    self._queue.not_begun(frame)
                    raise
        self._report_drops()

    def get(self, timeout_s: float | None = None) -> Passed[Any]:
        """Return the next item whose transform exists, with the transform.

        Items come in the order in which their transforms were found; those of one frame that are
        found together, by their stamps.

        Args:
            timeout_s: How long to wait for one, in seconds; None: until the gate is closed.

        Raises:
            TimeoutException: None came in time, or the gate is closed.
        """
        passed = self._next(timeout_s)
        if passed is None:
            what = "the gate is closed" if self._queue.closed else "no item has passed the gate"
            raise TimeoutException(what)
        return passed

    def stats(self) -> dict[str, int]:
        """Return how many items were `passed`, dropped by each reason, and are `held` or `ready`.

        `ready` items have their transforms, and wait for `get`.
        """
        with self._lock:
            queue = self._queue
            return dict(queue.counts) | {"held": queue.held, "ready": len(queue.ready)}

    def close(self) -> None:
        """Drop what has not been handed over. Iterations end. May be called again."""
        with self._lock:
            self._queue.close()
            self._closed.set()
            self._wake()
        self._report_drops()

    def _next(self, timeout_s: float | None) -> Passed[Any] | None:
        """The next item; None if there is none in time, or at the end."""
        queue = self._queue
        with self._lock:
            self._lock.wait_for(lambda: queue.ready or queue.closed, timeout_s)
            return queue.ready.popleft() if queue.ready else None

    def _begin(self, frame: str) -> None:
        """Let a thread serve a frame."""
        threads.start("gate", self._serve, frame)

    def _serve(self, frame: str) -> None:
        """Serve the items of a frame until none waits, or another thread does it."""
        try:
            while True:
                try:
                    with self._reports.converted():
                        self._look_up(frame)
                except TransformException:
                    self._pause(PAUSE_S)
                with self._lock:
                    wait = self._queue.begin_wait(frame, time.monotonic())
                self._report_drops()
                if wait is None:
                    return
                self._wait(*wait)
        except Exception:  # a bug
            log.exception("internal error of a gate")

    def _look_up(self, frame: str) -> None:
        """Look up the items of a frame, from the oldest on, as long as any is found."""
        with self._lock:
            items = self._queue.oldest(frame)
        for portion in portions(items):
            stamps = [held.stamp_ns for held in portion]
            answers = self._source.lookup_transforms(
                self.target, frame, stamps, max_gap_s=self._max_gap_s
            )
            with self._lock:
                if not self._queue.looked_up(portion, answers):
                    return
                self._wake()

    def _wait(self, held: Held[Any], timeout_s: float) -> None:
        """Wait for the transform of the oldest item of a frame."""
        begin_s = time.monotonic()
        try:
            with self._reports.converted():
                found = self._source.lookup_transform(
                    self.target, held.frame, held.stamp_ns, timeout_s, max_gap_s=self._max_gap_s
                )
        except ServiceException as error:
            with self._lock:
                self._queue.failed(held, error, for_good=False)
            self._pause(min(PAUSE_S, timeout_s))
        except TransformException as error:
            early = time.monotonic() < begin_s + timeout_s - EARLY_S
            with self._lock:
                self._queue.failed(held, error, for_good=early)
        else:
            with self._lock:
                self._queue.passed(held, found.transform, found.gap_ns)
                self._wake()
        finally:
            with self._lock:
                self._queue.end_wait(held)

    def _wake(self) -> None:
        """Let callers of `get` try again. Requires the lock."""
        self._lock.notify_all()
        self._loops.wake()

    def _pause(self, seconds: float) -> None:
        self._closed.wait(seconds)

    def _report_drops(self) -> None:
        """Report the drops, without the lock."""
        while True:
            with self._lock:
                if not self._queue.drops:
                    return
                dropped = self._queue.drops.popleft()
            if self._on_drop is not None:
                try:
                    self._on_drop(dropped)
                except Exception:
                    log.exception("on_drop of a gate has raised an error")
