"""What the routines of a feed wait for, as steps: threads of the feed take them, or an event loop.

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

import threading
from collections.abc import Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

from .. import wire

if TYPE_CHECKING:
    from .feed import MirrorFeed

#: How much longer than a plan a part of a copy may take. Many mirrors of a busy machine wait for
#: each other's parts: if all gave up and asked again, none would ever get one in time.
PART_WAIT_S: Final = 25.0


@dataclass(frozen=True, slots=True)
class Pause:
    """A step: wait. Its outcome is whether the feed has ended meanwhile."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Ask:
    """A step: send a request. Its outcome is the reply."""

    request_type: str
    body: wire.Message
    wait_s: float  # how much longer than others it may take


@dataclass(frozen=True, slots=True)
class AskStatus:
    """A step: ask the server who it is. Its outcome is a `ServerStatus`."""


T = TypeVar("T")

#: The steps of a routine. An error of a step is raised where the generator yielded it.
Steps = Generator[Pause | Ask | AskStatus, Any, T]


class Runner(Protocol):
    """Runs the routines of feeds. Thread safety: all methods."""

    def listen(self, feed: MirrorFeed) -> threading.Thread:
        """Let a thread apply the messages that come, until the feed is closed. Returns it."""

    def run(self, feed: MirrorFeed, steps: Steps[None]) -> bool:
        """Take the steps of a routine. False: there is no thread for it."""
