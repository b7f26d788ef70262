"""What the readers of containers have in common: a container gives raw messages of channels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from .decoders import Decode, decoder

#: The last part of a topic whose transforms hold at all times.
_STATIC_TOPIC: Final = "tf_static"


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic with transforms, and how its messages are decoded."""

    topic: str
    decode: Decode

    static: bool  # its links hold at all times


def channel(topic: str, message_type: str, encoding: str) -> Channel | None:
    """A channel with messages of a type in an encoding; None if it has no transforms."""
    decode = decoder(message_type, encoding)
    if decode is None:
        return None
    return Channel(topic, decode, topic.rsplit("/", 1)[-1] == _STATIC_TOPIC)


class RawMessage(NamedTuple):
    """A message that is not decoded yet."""

    log_ns: int  # when it was recorded
    channel: Channel
    data: bytes


class Container(Protocol):
    """An open file or folder. `messages` may be called again, for another pass."""

    @property
    def message_count(self) -> int | None:
        """How many messages with transforms there are; None if only reading shows it."""

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
