"""What the readers of containers have in common: a container gives raw messages of channels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from .decoders import Decode


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


class Container(Protocol):
    """An open file or folder. `messages` may be called again, for another pass."""

    @property
    def message_count(self) -> int | None:
        """How many messages are read; None if only reading shows it."""

    @property
    def is_empty(self) -> bool:
        """Whether it is known to have no messages at all, not even of other types."""

    @property
    def is_cut_off(self) -> bool:
        """Whether the file lacks its end, as after a crash of what recorded it."""

    def messages(self) -> Iterator[RawMessage]:
        """Yield the messages with transforms in the order of the log.

        Raises any exception if the file is damaged: libraries differ.
        """

    def close(self) -> None:
        """Close the files."""
