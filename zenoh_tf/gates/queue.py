"""The items that a gate holds, and what becomes of each, without any I/O.

Items of one frame share a wait: for the oldest stamp among them. Once its transform exists, the
newer ones are looked up together. An item that is older than what is waited for begins a second
wait, a short one, which is renewed for the oldest item until the first one ends: stamps that go
back would else need a wait each. An item leaves exactly once: handed over, or dropped with a
reason.

Thread safety: none; the gate locks.
"""

from __future__ import annotations

import itertools
import logging
import sys
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import GenericAlias
from typing import TYPE_CHECKING, Any, Final, Generic, Literal, NamedTuple, TypeVar

from zenoh_tf._core import StampedTransform
from zenoh_tf.array import TransformArray
from zenoh_tf.errors import (
    BackwardExtrapolationException,
    GapTooLong,
    LookupException,
    ServiceException,
    TransformException,
    must_be,
)

T = TypeVar("T")

Reason = Literal["too_old", "gap", "full", "timeout", "unknown_frame", "closed"]
REASONS: Final[tuple[Reason, ...]] = (
    *("too_old", "gap", "full", "timeout", "unknown_frame", "closed"),
)

#: After an error of the service, the next attempt.
PAUSE_S: Final = 0.05
#: A lookup that ends earlier before its time-out than this can never succeed.
EARLY_S: Final = 0.005
#: Most frames whose items wait at once: each needs a thread or a task, and at times a second one.
MAX_FRAMES: Final = 64
MAX_QUEUE_SIZE: Final = 100_000
#: Items that are looked up together.
_ROWS: Final = 256
#: The longest single wait. Then all items of the frame are looked up again, in case that an older
#: one, which can never have a transform, holds up newer ones.
_LONGEST_WAIT_S: Final = 1.0
#: The longest wait beside another one of the frame: nobody else sees older items meanwhile.
_SECOND_WAIT_S: Final = 0.05
#: Waits of one frame at once.
_MAX_WAITS: Final = 2


if TYPE_CHECKING or sys.version_info >= (3, 11):

    class Passed(NamedTuple, Generic[T]):
        """An item that a gate hands over, with its transform: ``item, transform = gate.get()``.

        Attributes:
            item: What was put.
            transform: `X_target_frame` at the item's stamp, in metres: parent_frame is the gate's
                target, child_frame the item's frame.
        """

        item: T
        transform: StampedTransform

else:  # a NamedTuple can have no other base

    class Passed(NamedTuple):
        """An item that a gate hands over, with its transform."""

        item: Any
        transform: StampedTransform

        __class_getitem__ = classmethod(GenericAlias)


@dataclass(frozen=True, slots=True)
class Dropped(Generic[T]):
    """An item that a gate has given up.

    The threads of the gate may still report some when `close` has returned.

    Attributes:
        item: What was put.
        frame: Its frame.
        stamp_ns: Its time in nanoseconds.
        reason: `"too_old"`: the time is before the history of a link. `"gap"`: the samples of a
            link around the time are farther apart than the gate's `max_gap_s`. `"full"`: the gate
            held as many items, or items of as many frames, as it may. `"timeout"`: the transform
            did not come in time. `"unknown_frame"`: nor did a frame of the lookup. `"closed"`: the
            gate was closed before.
        error: The last error of the lookup, with its facts; None if there was none.
    """

    item: T
    frame: str
    stamp_ns: int
    reason: Reason
    error: TransformException | None = None


@dataclass(slots=True, eq=False)
class Held(Generic[T]):
    """An item that waits."""

    item: T
    frame: str
    stamp_ns: int
    deadline_s: float
    number: int  # in the order of arrival


class GateQueue(Generic[T]):
    """The items of one gate."""

    def __init__(self, target: str, queue_size: int, timeout_s: float) -> None:
        if not isinstance(queue_size, int) or not 1 <= queue_size <= MAX_QUEUE_SIZE:
            raise must_be("queue_size", f"from 1 to {MAX_QUEUE_SIZE:,}", queue_size)
        if not 0 < timeout_s <= 3600:
            raise must_be("timeout_s", "above 0 and at most 3600", timeout_s)
        self.target = target
        self.ready: deque[Passed[T]] = deque()
        #: Drops that are not reported yet.
        self.drops: deque[Dropped[T]] = deque()
        self.counts: Counter[str] = Counter({"passed": 0} | dict.fromkeys(REASONS, 0))
        self.closed = False
        self._queue_size = queue_size
        self._timeout_s = timeout_s
        self._frames: dict[str, dict[int, Held[T]]] = {}  # by frame, then by number
        #: How many items wait.
        self.held = 0
        self._numbers = itertools.count()
        self._looking: Counter[str] = Counter()  # rounds that look up, and will see new items
        self._waits: dict[str, list[int]] = {}  # the stamps that are waited for
        self._errors: dict[str, TransformException] = {}  # the last of each frame that waits

    def put(self, item: T, frame: str, stamp_ns: int, now_s: float) -> bool:
        """Hold an item. True: the caller has to begin a round for its frame, or `not_begun`."""
        held = Held(item, frame, stamp_ns, now_s + self._timeout_s, next(self._numbers))
        if self.closed:
            self._report(held, "closed")
        elif self.held + len(self.ready) >= self._queue_size or (
            frame not in self._frames and len(self._frames) >= MAX_FRAMES
        ):
            # The new one: the oldest is the next to succeed.
            self._report(held, "full")
        else:
            self._frames.setdefault(frame, {})[held.number] = held
            self.held += 1
            waits = self._waits.get(frame, ())
            covered = len(waits) >= _MAX_WAITS or any(stamp <= stamp_ns for stamp in waits)
            if not covered and not self._looking[frame]:
                self._looking[frame] += 1
                return True
        return False

    def not_begun(self, frame: str) -> None:
        """Undo the last `put`, whose round could not begin: nobody would serve its item."""
        self._end_look(frame)
        self._remove(next(reversed(self._frames[frame].values())))

    def oldest(self, frame: str) -> list[Held[T]]:
        """The items of a frame, by their stamps."""
        return sorted(self._frames.get(frame, {}).values(), key=lambda held: held.stamp_ns)

    def looked_up(self, items: Iterable[Held[T]], answers: TransformArray) -> bool:
        """Apply the answers of a lookup of several items. False: none was found."""
        found = False
        for row, held in enumerate(items):
            if not answers.status[row]:
                found = True
                self.passed(held, answers[row], int(answers.gaps_ns[row]))
            elif answers.status[row] == BackwardExtrapolationException.code:
                self.drop(held, "too_old")
            elif answers.status[row] == GapTooLong.code:
                self.drop(held, "gap")
        return found

    def passed(self, held: Held[T], transform: Any, gap_ns: int) -> None:
        """Hand an item over, unless it has left."""
        if self._remove(held):
            stamped = StampedTransform(
                self.target, held.frame, held.stamp_ns, transform, gap_ns=gap_ns
            )
            self.ready.append(Passed(held.item, stamped))
            self.counts["passed"] += 1

    def drop(self, held: Held[T], reason: Reason) -> None:
        """Give an item up, unless it has left."""
        error = self._errors.get(held.frame)
        if self._remove(held):
            self._report(held, reason, error)

    def failed(self, held: Held[T], error: TransformException, *, for_good: bool) -> None:
        """Record why an item's lookup failed. `for_good`: it can never succeed."""
        if held.frame in self._frames:
            self._errors[held.frame] = error
        if isinstance(error, LookupException):
            if for_good:  # such as a frame outside of what a mirror has
                self.drop(held, "unknown_frame")
        elif isinstance(error, GapTooLong):
            self.drop(held, "gap")
        elif isinstance(error, BackwardExtrapolationException) or for_good:
            self.drop(held, "too_old")

    def begin_wait(self, frame: str, now_s: float) -> tuple[Held[T], float] | None:
        """Return what to wait for, and for how many seconds at most; to be followed by `end_wait`.

        None: nothing waits, or another wait covers it. Ends a round that looks up, which `put` or
        `end_wait` began.
        """
        self._end_look(frame)
        for held in list(self._frames.get(frame, {}).values()):
            if held.deadline_s > now_s:
                break  # all have the same time-out
            unknown = isinstance(self._errors.get(frame), LookupException)
            self.drop(held, "unknown_frame" if unknown else "timeout")
        items = self._frames.get(frame)
        if not items:
            return None
        oldest = min(items.values(), key=lambda held: held.stamp_ns)
        waits = self._waits.setdefault(frame, [])
        if any(stamp <= oldest.stamp_ns for stamp in waits):
            return None
        waits.append(oldest.stamp_ns)
        left_s = next(iter(items.values())).deadline_s - now_s
        return oldest, min(left_s, _LONGEST_WAIT_S if len(waits) == 1 else _SECOND_WAIT_S)

    def end_wait(self, held: Held[T]) -> None:
        """Record that nobody waits for an item's stamp any more, and a round of lookups begins."""
        waits = self._waits[held.frame]
        waits.remove(held.stamp_ns)
        if not waits:
            del self._waits[held.frame]
        self._looking[held.frame] += 1

    def close(self) -> None:
        """Drop everything."""
        self.closed = True
        for items in list(self._frames.values()):
            for held in list(items.values()):
                self.drop(held, "closed")
        while self.ready:
            passed = self.ready.popleft()
            self.counts["passed"] -= 1
            stamped = passed.transform
            self._dropped(
                Dropped(passed.item, stamped.child_frame, stamped.stamp_ns, "closed", None)
            )

    def _end_look(self, frame: str) -> None:
        self._looking[frame] -= 1
        if not self._looking[frame]:
            del self._looking[frame]

    def _remove(self, held: Held[T]) -> bool:
        items = self._frames.get(held.frame, {})
        if items.pop(held.number, None) is None:
            return False
        self.held -= 1
        if not items:
            del self._frames[held.frame]
            self._errors.pop(held.frame, None)
        return True

    def _report(
        self, held: Held[T], reason: Reason, error: TransformException | None = None
    ) -> None:
        self._dropped(Dropped(held.item, held.frame, held.stamp_ns, reason, error))

    def _dropped(self, dropped: Dropped[T]) -> None:
        self.counts[dropped.reason] += 1
        self.drops.append(dropped)


def portions(items: list[Held[T]]) -> Iterable[list[Held[T]]]:
    """The items, as many as are looked up together at a time."""
    return (items[begin : begin + _ROWS] for begin in range(0, len(items), _ROWS))


def check_item(frame: object, stamp_ns: object) -> None:
    """Raise InvalidArgumentException for what no lookup accepts."""
    if not isinstance(frame, str) or not frame or frame.startswith("/"):
        raise must_be("frame", "the name of a frame, without '/' in front", frame)
    if not isinstance(stamp_ns, int) or not -(1 << 63) < stamp_ns < 1 << 63:
        raise must_be("stamp_ns", "an int of nanoseconds", stamp_ns)


class FirstError:
    """Turns errors that no lookup should raise into ServiceException, and logs the first one.

    So a gate tries again, and reports the items whose time is over.
    """

    def __init__(self, to: logging.Logger) -> None:
        self._log = to
        self._is_logged = False

    @contextmanager
    def converted(self) -> Iterator[None]:
        """Raise ServiceException for any error in the block that is no TransformException."""
        try:
            yield
        except TransformException:
            raise
        except Exception as error:
            if not self._is_logged:  # else twenty times a second
                self._is_logged = True
                self._log.exception("a lookup of a gate has failed; the gate tries again")
            raise ServiceException(f"the lookup has failed: {error!r}") from error


OnDrop = Callable[[Dropped[Any]], object]
