"""What the feed of a mirror needs from its owner, and what it reports: sources, runners, states.

Thread safety: all methods; states are immutable.

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import zenoh
from zenoh.handlers import RingChannel

from .. import wire
from ..steps import Ask, Pause, Steps
from ..tree import TransformTree

if TYPE_CHECKING:
    from .feed import MirrorFeed


@dataclass(frozen=True, slots=True)
class ServerStatus:
    """What a server says of itself in the reply to `hello`."""

    instance: str
    clock_ns: int
    seq: int | None  # the number of its last commit; None if it does not say
    real_ns: int | None = None  # its real-time clock; None if it does not say


@dataclass(frozen=True, slots=True)
class State:
    """What a mirror has. The tree itself may be newer already, but never older."""

    tree: TransformTree | None = None  # the last complete copy; another one after a new snapshot
    instance: str = ""  # of the server whose tree it is
    seq: int = 0  # the number of the last commit in it
    clock_ns: int = 0  # the server's clock when it was so: what the age is counted from
    synced: bool = False  # nothing is known to be missing

    def has(self, instance: str, seq: int) -> bool:
        """Whether it has a commit of an instance, and all before it."""
        return self.instance == instance and self.seq >= seq


class Source(Protocol):
    """How a feed listens and asks. All raise ServerUnavailable once the connection is closed."""

    @property
    def tree(self) -> str:
        """The tree's name."""

    @property
    def calls(self) -> AbstractContextManager[None]:
        """To be entered while a message is waited for."""

    def subscribe(self, channel: RingChannel[zenoh.Sample]) -> zenoh.Subscriber[Any]:
        """Listen to the stream."""

    def unsubscribe(self, subscriber: zenoh.Subscriber[Any]) -> bool:
        """Undeclare a subscriber; never raises. False: the process is forked."""

    def ask(self, request_type: str, body: wire.Message, wait_s: float) -> Steps[wire.Message]:
        """Send a request, and return the reply, or raise its error. It may take `wait_s` longer
        than others."""

    def status(self) -> Steps[ServerStatus]:
        """Ask the server who it is, and for its clock and its last commit."""

    def take(self, step: Ask | Pause) -> object:
        """Take a step with blocking calls, and return its outcome."""


class Runner(Protocol):
    """Runs the routines of feeds. Thread safety: all methods."""

    def listen(self, feed: MirrorFeed) -> threading.Thread:
        """Let a thread apply the messages that come, until the feed is closed. Returns it."""

    def run(self, feed: MirrorFeed, steps: Steps[None]) -> bool:
        """Take the steps of a routine. False: there is no thread for it."""
