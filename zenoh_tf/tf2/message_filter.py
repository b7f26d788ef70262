"""`MessageFilter` and `TransformFilter`: hold messages until their transforms are there.

They are filters as in message_filters: connect them to a subscriber, and connect others to them.
"""

from __future__ import annotations

import asyncio
import enum
import itertools
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import threads
from zenoh_tf.errors import (
    MAY_SUCCEED_LATER,
    InvalidArgumentException,
    LimitExceeded,
    ServerBusy,
    ServerRestarted,
    ServerUnavailable,
    ServiceException,
    TransformException,
    must_be,
)

from .buffer import Buffer
from .messages import TransformStamped
from .times import seconds, stamp_ns
from .wait_loop import WaitLoop

if TYPE_CHECKING:
    from typing_extensions import Self

log = logging.getLogger("zenoh_tf.client")

#: The pause before a message waits again, because there was no server or it was busy.
_PAUSE_S: Final = 0.5
#: Errors that may be over when the server is back.
_NO_SERVER: Final = (ServerBusy, ServerRestarted, ServerUnavailable)


class FilterFailureReason(enum.IntEnum):
    """Why a filter dropped a message: tf2's reasons, with the same numbers."""

    #: Another error, such as a wrong frame name or a closed connection.
    UNKNOWN = 0
    #: The message is older than all data of a link, and no later write can change that.
    OUT_THE_BACK = 1
    #: The message names no frame.
    EMPTY_FRAME_ID = 2
    #: The time-out was over, or no write can make the lookup succeed.
    NO_TRANSFORM_FOUND = 3
    #: A newer message took the place of this one, the oldest in the queue.
    QUEUE_FULL = 4


#: Called with a message that was dropped, the reason, and an error that says more.
FailureCallback = Callable[[Any, FilterFailureReason, TransformException], object]


class _Held:
    """A message that waits for its transforms, and then for its callbacks."""

    __slots__ = ("lookup", "message", "outcome")

    def __init__(self, message: Any) -> None:
        self.message = message
        self.lookup: Future[None] | None = None
        self.outcome: list[TransformStamped] | TransformException | None = None


class TransformFilter:
    """Calls back with each message and its transform, once the transform is there.

    A message waits in the tree, as a lookup with a time-out does, without a thread and without
    polling. Messages are passed on in the order in which their transforms arrive. Callbacks run
    one after another on a thread of the filter; a slow one holds up only this filter, whose queue
    fills meanwhile. A context manager, which closes itself at the end.

    Thread safety: all methods.

    Args:
        input_filter: Where the messages come from: an object with ``registerCallback``, such as a
            message_filters.Subscriber; None if `add` gets them.
        buffer: A `Buffer`.
        target_frame: The frame to transform to, or a sequence of frames.
        queue_size: How many messages are held at most. The oldest makes room for one more.
        node: Has no effect.
        buffer_timeout: How long a message may wait; None for as long as there is room.

    Raises:
        ServerUnavailable: No server answers.
        InvalidArgumentException: `queue_size` is not positive.

    Example:
        ``TransformFilter(None, Buffer(), "map", 10).registerCallback(use)``
    """

    def __init__(
        self,
        input_filter: Any,
        buffer: Buffer,
        target_frame: str | Sequence[str],
        queue_size: int,
        node: Any = None,
        buffer_timeout: Any = None,
    ) -> None:
        if queue_size < 1:
            raise must_be("queue_size", "positive", queue_size)
        self._buffer = buffer
        buffer._source.waits()
        self._is_single = isinstance(target_frame, str)
        self._targets = (target_frame,) if isinstance(target_frame, str) else tuple(target_frame)
        self._queue_size = queue_size
        self._timeout_s = math.inf
        if buffer_timeout is not None:
            self._timeout_s = seconds(buffer_timeout, "buffer_timeout")
        self._callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...]]] = {}
        self._failure_callbacks: dict[int, FailureCallback] = {}
        self._ids = itertools.count()
        self._changed = threading.Condition()  # guards what follows
        self._held: dict[_Held, None] = {}  # the oldest first
        self._ready: dict[_Held, None] = {}  # those of them with an outcome, in its order
        self._closed = False
        self._counts = dict.fromkeys(("received", "passed", "callback_errors"), 0)
        self._counts |= {reason.name.lower(): 0 for reason in FilterFailureReason}
        self._thread = threads.start("tf2 filter", self._call_back)
        if input_filter is not None:
            self.connectInput(input_filter)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def connectInput(self, input_filter: Any) -> None:
        """Receive the messages of another filter.

        Args:
            input_filter: An object with ``registerCallback``.
        """
        input_filter.registerCallback(self.add)

    def registerCallback(self, callback: Callable[..., object], *arguments: Any) -> int:
        """Call back with each message whose transform is there.

        Args:
            callback: Called with the message, its TransformStamped ``X_target_message`` (a list
                of them for a sequence of target frames; `MessageFilter` leaves it out), and
                `arguments`.
            arguments: Passed on to `callback`.

        Returns:
            The number of the registration.
        """
        number = next(self._ids)
        self._callbacks[number] = callback, arguments
        return number

    def registerFailureCallback(self, callback: FailureCallback) -> int:
        """Call back with each message that is dropped.

        If a message is dropped for a newer one, the callback runs inside the call of `add`.

        Args:
            callback: Called with the message, the `FilterFailureReason`, and the error that says
                more: that of the lookup, or LimitExceeded for a full queue.

        Returns:
            The number of the registration.
        """
        number = next(self._ids)
        self._failure_callbacks[number] = callback
        return number

    def add(self, message: Any, *_: Any) -> None:
        """Hold a message until its transform is there. Does not wait.

        Args:
            message: Any message with a header.
        """
        header = message.header
        frame, stamp = header.frame_id, stamp_ns(header.stamp, "header.stamp")
        held = _Held(message)
        oldest = None
        with self._changed:
            if self._closed:
                return
            self._counts["received"] += 1
            if len(self._held) >= self._queue_size:
                oldest = next(iter(self._held))
                self._forget(oldest)
            self._held[held] = None
        if oldest is not None:
            error = LimitExceeded(
                f"the filter's queue of {self._queue_size:,} messages is full; it must hold "
                "as many as come while a transform is late (queue_size)",
                field="queue_size",
                limit=self._queue_size,
            )
            self._report(oldest.message, FilterFailureReason.QUEUE_FULL, error)
        if not frame:
            self._settle(
                held, InvalidArgumentException("the message names no frame", field="frame_id")
            )
            return
        try:
            loop = self._buffer._source.waits()
            lookup = loop.start(self._wait(held, loop, frame, stamp))
        except TransformException as unavailable:
            self._settle(held, unavailable)
            return
        with self._changed:
            held.lookup = lookup
            is_dropped = held not in self._held
        if is_dropped:
            lookup.cancel()

    def clear(self) -> None:
        """Drop all messages held, without a callback."""
        with self._changed:
            for held in list(self._held):
                self._forget(held)

    def close(self) -> None:
        """Drop all messages held, and accept no more. May be called again."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self.clear()

    def stats(self) -> dict[str, int]:
        """Return the counters of the filter.

        Returns:
            ``received``, ``passed``, ``held`` now, ``callback_errors``, and how many messages were
            dropped for each `FilterFailureReason`, under its name in small letters.
        """
        with self._changed:
            return self._counts | {"held": len(self._held)}

    def _arguments(self, message: Any, transforms: list[TransformStamped]) -> tuple[Any, ...]:
        """What callbacks get before their own arguments."""
        return (message, transforms[0] if self._is_single else transforms)

    # --- on the loop of the waits

    async def _wait(self, held: _Held, loop: WaitLoop, frame: str, stamp: int | None) -> None:
        """Look up all transforms of a message, one after another: the others arrive meanwhile."""
        deadline_s, gap = time.monotonic() + self._timeout_s, self._buffer._max_gap_s
        try:
            self._settle(
                held,
                [
                    await _look_up(loop, (target, frame, stamp), gap, deadline_s)
                    for target in self._targets
                ],
            )
        except TransformException as error:
            self._settle(held, error)
        except Exception as error:  # a bug; the message must not be held for ever
            log.exception("a lookup of a message filter failed")
            self._settle(held, ServiceException(f"the lookup has failed: {error!r}"))
        except asyncio.CancelledError:
            # Dropped, which leaves nothing to settle; or the connection was closed.
            self._settle(held, ServerUnavailable("the connection is closed"))
            raise

    def _settle(self, held: _Held, outcome: list[TransformStamped] | TransformException) -> None:
        with self._changed:
            if held in self._held:  # else it was dropped meanwhile
                held.outcome = outcome
                self._ready[held] = None
                self._changed.notify()

    # --- on the filter's thread

    def _call_back(self) -> None:
        while (held := self._next()) is not None:
            outcome = held.outcome
            if isinstance(outcome, TransformException):
                self._report(held.message, _reason(outcome), outcome)
            elif outcome is not None:
                with self._changed:
                    self._counts["passed"] += 1
                given = self._arguments(held.message, outcome)
                for callback, arguments in list(self._callbacks.values()):
                    self._call(callback, *given, *arguments)

    def _next(self) -> _Held | None:
        """Wait for the next message with an outcome; None at the end."""
        with self._changed:
            while not self._ready and not self._closed:
                self._changed.wait()
            if self._closed:
                return None
            held = next(iter(self._ready))
            self._forget(held)
            return held

    def _forget(self, held: _Held) -> None:
        """Requires the lock."""
        self._held.pop(held, None)
        self._ready.pop(held, None)
        if held.lookup is not None:
            held.lookup.cancel()  # without effect if it is done

    def _report(self, message: Any, reason: FilterFailureReason, error: TransformException) -> None:
        with self._changed:
            self._counts[reason.name.lower()] += 1
        for callback in list(self._failure_callbacks.values()):
            self._call(callback, message, reason, error)

    def _call(self, callback: Callable[..., object], *arguments: Any) -> None:
        try:
            callback(*arguments)
        except BaseException as error:
            # Also `sys.exit`, which would end the filter's thread only, and without a word. In a
            # thread of the caller, inside of `add`, it does what it says.
            if not isinstance(error, Exception) and threading.current_thread() is not self._thread:
                raise
            with self._changed:
                self._counts["callback_errors"] += 1
            log.exception("a callback of a message filter failed")


class MessageFilter(TransformFilter):
    """As `TransformFilter`, but calls back with the message only, as tf2_ros does in C++.

    The transform is in the tree by then, but a lookup in the callback may find newer data, or
    none if the callback comes late. `TransformFilter` hands it over.

    Thread safety: all methods.
    """

    def _arguments(self, message: Any, transforms: list[TransformStamped]) -> tuple[Any, ...]:
        return (message,)


async def _look_up(
    loop: WaitLoop, lookup: tuple[str, str, int | None], gap: float | None, deadline_s: float
) -> TransformStamped:
    """As `WaitLoop.look_up`; waits for a server that is busy or away, too."""
    while True:
        try:
            return await loop.look_up(
                lambda tree, wait_s: tree.lookup_transform(*lookup, wait_s, max_gap_s=gap),
                deadline_s,
            )
        except _NO_SERVER:
            if loop.is_closed() or time.monotonic() + _PAUSE_S >= deadline_s:
                raise
            await asyncio.sleep(_PAUSE_S)


def _reason(error: TransformException) -> FilterFailureReason:
    stamp, oldest = error.stamp_ns, error.oldest_stamp_ns
    if stamp is not None and oldest is not None and stamp < oldest:
        return FilterFailureReason.OUT_THE_BACK
    if isinstance(error, MAY_SUCCEED_LATER):
        return FilterFailureReason.NO_TRANSFORM_FOUND
    if isinstance(error, InvalidArgumentException) and error.field == "frame_id":
        return FilterFailureReason.EMPTY_FRAME_ID
    return FilterFailureReason.UNKNOWN
