"""What the readers of containers have in common: a container gives raw messages of channels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from ...formats.rows import Decode


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """A topic that is read, and how its messages are decoded."""

    topic: str
    decode: Decode
    static: bool  # its links hold at all times
    source: str  # equal of topics that describe one tree, as /tf and /tf_static do
    prefix: str  # of its frames; "" for none


#: The channel of a topic by its name, type of messages, and encoding; None if it is not read.
Choose = Callable[[str, str, str], Channel | None]


class RawMessage(NamedTuple):
    """A message that is not decoded yet."""

    log_ns: int  # when it was recorded
    channel: Channel
    data: bytes


@dataclass(slots=True)
class Damage:
    """The damaged places of a file that were found so far. What they had is left out."""

    count: int = 0
    first: str = ""

    def note(self, place: str, why: str) -> None:
        """Count a place, such as "byte 1,234"."""
        self.count += 1
        self.first = self.first or f"at {place}: {why}"


class Container(ABC):
    """An open file. `messages` may be called again, for another pass."""

    def __init__(self, path: Path) -> None:
        self.path = path
        #: How many messages are read; None if only reading shows it.
        self.message_count: int | None = None
        #: Whether it is known to have no messages at all, not even of other types.
        self.is_empty = False
        #: Whether the file lacks its end, as after a crash of what recorded it.
        self.is_cut_off = False
        #: What is damaged, as found by the last pass over it.
        self.damage = Damage()

    @abstractmethod
    def messages(self) -> Iterator[RawMessage]:
        """Yield the messages in the order of the log, without those in damaged places.

        Raises any exception if the file cannot be read any more: libraries differ.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the file."""


class ChunkedFile(Container):
    """A file of chunks, which is read by its index, or from the beginning if it has no valid one.

    A subclass opens it in `_open`, which sets `_has_index`, and `_fault` if the index is damaged.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._has_index = False
        self._fault = ""
        self._size = path.stat().st_size
        self._file = path.open("rb")
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def _open(self) -> None:
        """Read what is needed to read the rest."""

    @abstractmethod
    def _indexed(self) -> Iterator[tuple[int, list[RawMessage]]]:
        """The chunks by the index, as of `in_log_order`."""

    @abstractmethod
    def _scanned(self) -> Iterator[tuple[int, list[RawMessage]]]:
        """The chunks from the beginning, as of `in_log_order`."""

    def messages(self) -> Iterator[RawMessage]:
        self.damage = Damage()
        if self._fault:
            self.damage.note("its end", f"the index cannot be read: {self._fault}")
        return in_log_order(self._indexed() if self._has_index else self._scanned())

    def close(self) -> None:
        self._file.close()


_log_time = attrgetter("log_ns")


def in_log_order(chunks: Iterable[tuple[int, list[RawMessage]]]) -> Iterator[RawMessage]:
    """Yield the messages of chunks, which may overlap in time.

    Args:
        chunks: The time before which neither a chunk nor those after it have messages, and its
            messages.
    """
    waiting: list[RawMessage] = []
    for begin_ns, found in chunks:
        if waiting and begin_ns <= waiting[-1].log_ns:
            ready = [message for message in waiting if message.log_ns < begin_ns]
            waiting = [message for message in waiting if message.log_ns >= begin_ns]
        else:
            ready, waiting = waiting, []
        yield from ready
        waiting += found
        waiting.sort(key=_log_time)  # stable: equal times stay in the order of the file
    yield from waiting
