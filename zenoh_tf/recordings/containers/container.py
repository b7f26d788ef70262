"""What the readers of containers have in common: a container gives raw messages of channels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple, Protocol

from ..decoders import Decode


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


class Container(Protocol):
    """An open file. `messages` may be called again, for another pass."""

    path: Path

    @property
    def message_count(self) -> int | None:
        """How many messages are read; None if only reading shows it."""

    @property
    def is_empty(self) -> bool:
        """Whether it is known to have no messages at all, not even of other types."""

    @property
    def is_cut_off(self) -> bool:
        """Whether the file lacks its end, as after a crash of what recorded it."""

    @property
    def damage(self) -> Damage:
        """What is damaged, as found by the last pass over it."""

    def messages(self) -> Iterator[RawMessage]:
        """Yield the messages in the order of the log, without those in damaged places.

        Raises any exception if the file cannot be read any more: libraries differ.
        """

    def close(self) -> None:
        """Close the file."""


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
