"""`Gate`: holds sensor data until its transform exists."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Protocol, Self

from zenoh_tf._core import StampedTransform
from zenoh_tf.array import TransformArray
from zenoh_tf.errors import ServiceException, TimeoutException, TransformException
from zenoh_tf.gate_queue import (
    GateQueue,
    Held,
    OnDrop,
    Passed,
    check_item,
    portions,
)

from . import threads

log = logging.getLogger("zenoh_tf")

#: After an error of the service, the next attempt.
PAUSE_S = 0.05
#: A lookup that ends earlier before its time-out than this can never succeed.
EARLY_S = 0.005


class FirstError:
    """Turns errors that no lookup should raise into ServiceException, and logs the first one.

    So a gate tries again, and reports the items whose time is over.
    """

    def __init__(self, to: logging.Logger) -> None:
        self._log = to
        self._is_told = False

    @contextmanager
    def converted(self) -> Iterator[None]:
        """Raise ServiceException for any error in the block that is no TransformException."""
        try:
            yield
        except TransformException:
            raise
        except Exception as error:
            if not self._is_told:  # else twenty times a second
                self._is_told = True
                self._log.exception("a lookup of a gate has failed; the gate tries again")
            raise ServiceException(f"the lookup has failed: {error!r}") from error


class Source(Protocol):
    """What a gate looks up in: a tree, a client or a mirror."""

    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> StampedTransform: ...
    def lookup_transforms(
        self, targets: str, sources: str, stamps_ns: list[int]
    ) -> TransformArray: ...


class Gate:
    """Holds items until their transforms exist; made by `gate` of a tree or a client.

    Put images, clouds or detections in as they arrive, each with its frame and stamp. The gate
    hands each over together with `X_target_frame` at its stamp, from the one lookup that found it:
    so no later lookup can fail. What it cannot hand over it drops, and says why. A lookup that
    waits costs nothing until a write may have made it possible, and items of one frame share it.
    A context manager, which closes itself at the end.

    Thread safety: all methods.

    Example:
        ``for image, transform in gate: show(image, transform.transform)``

    Attributes:
        target: The frame to express coordinates in.
    """

    def __init__(
        self, source: Source, target: str, queue_size: int, timeout_s: float, on_drop: OnDrop | None
    ) -> None:
        """Use `TransformTree.gate` or `TransformClient.gate` instead.

        Raises:
            InvalidArgumentException: An argument makes no sense.
        """
        check_item(target, 0)
        self.target = target
        self._source = source
        self._on_drop = on_drop
        self._queue: GateQueue[Any] = GateQueue(target, queue_size, timeout_s)
        self._changed = threading.Condition()
        self._closed = threading.Event()
        self._reports = FirstError(log)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[Passed[Any]]:
        """Iterate over items and their transforms, until the gate is closed."""
        while True:
            passed = self._next(None)
            if passed is None:
                return
            yield passed

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
        with self._changed:
            # The thread starts under the lock: else others might put, and rely on it.
            if self._queue.put(item, frame, stamp_ns, time.monotonic()):
                try:
                    threads.start("gate", self._serve, frame)
                except BaseException:
                    self._queue.not_begun(frame)
                    raise
        self._tell()

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
        with self._changed:
            queue = self._queue
            return dict(queue.counts) | {"held": queue.held, "ready": len(queue.ready)}

    def close(self) -> None:
        """Drop what has not been handed over. Iterations end. May be called again."""
        with self._changed:
            self._queue.close()
            self._closed.set()
            self._changed.notify_all()
        self._tell()

    def _next(self, timeout_s: float | None) -> Passed[Any] | None:
        queue = self._queue
        with self._changed:
            self._changed.wait_for(lambda: queue.ready or queue.closed, timeout_s)
            return queue.ready.popleft() if queue.ready else None

    def _serve(self, frame: str) -> None:
        """Serve the items of a frame until none waits, or another thread does it."""
        try:
            while True:
                try:
                    with self._reports.converted():
                        self._look_up(frame)
                except TransformException:
                    self._closed.wait(PAUSE_S)
                with self._changed:
                    wait = self._queue.begin_wait(frame, time.monotonic())
                self._tell()
                if wait is None:
                    return
                self._wait(*wait)
        except Exception:  # a bug
            log.exception("internal error of a gate")

    def _look_up(self, frame: str) -> None:
        """Look up the items of a frame, from the oldest on, as long as any is found."""
        with self._changed:
            items = self._queue.oldest(frame)
        for portion in portions(items):
            stamps = [held.stamp_ns for held in portion]
            answers = self._source.lookup_transforms(self.target, frame, stamps)
            with self._changed:
                found = self._queue.looked_up(portion, answers)
                if found:
                    self._changed.notify_all()
            if not found:
                return

    def _wait(self, held: Held[Any], timeout_s: float) -> None:
        """Wait for the transform of the oldest item of a frame."""
        begin_s = time.monotonic()
        error: TransformException | None = None
        try:
            with self._reports.converted():
                found = self._source.lookup_transform(
                    self.target, held.frame, held.stamp_ns, timeout_s
                )
        except ServiceException as failure:
            error = failure
            self._closed.wait(min(PAUSE_S, timeout_s))
        except TransformException as failure:
            error = failure
        early = time.monotonic() < begin_s + timeout_s - EARLY_S
        with self._changed:
            self._queue.end_wait(held)
            if error is None:
                self._queue.passed(held, found.transform)
                self._changed.notify_all()
            else:
                for_good = early and not isinstance(error, ServiceException)
                self._queue.failed(held, error, for_good=for_good)

    def _tell(self) -> None:
        """Report the drops, without the lock."""
        while True:
            with self._changed:
                if not self._queue.drops:
                    return
                dropped = self._queue.drops.popleft()
            if self._on_drop is not None:
                try:
                    self._on_drop(dropped)
                except Exception:
                    log.exception("on_drop of a gate has raised an error")
