"""The client that asks, the handler of its request, and the callbacks for the reply."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

from zenoh_tf import wire

from ..ingest.clock_offsets import ClockOffsets
from ..limits import Limits
from .counters import RequestCounters
from .guard import RequestGuard
from .info import InfoRequests

#: In place of the id of a client that is not connected, or has not said who it is.
UNKNOWN: Final = ""


class ReplyCallback(Protocol):
    """Called exactly once, with the reply to one request."""

    @property
    def client(self) -> str:
        """The id of the client that sent the request; empty if it is not known."""

    def __call__(self, reply: bytes, failed: bool) -> None:
        """Send the reply's bytes; `failed`: they are an error."""


class ReplyWithField:
    """The ReplyCallback of a request whose reply gets one more field."""

    __slots__ = ("_name", "_reply_to", "_value", "client")

    def __init__(self, reply_to: ReplyCallback, name: str, value: Callable[[], Any]) -> None:
        """`value` is called after the request has run."""
        self.client = reply_to.client
        self._reply_to = reply_to
        self._name = name
        self._value = value

    def __call__(self, reply: bytes, failed: bool) -> None:
        self._reply_to(wire.with_field(reply, self._name, self._value()), failed)


class Handler(Protocol):
    """Serves the requests to one tree: the server's `Service`, or a replica's."""

    @property
    def requests(self) -> RequestCounters:
        """How many requests were served, with which outcome."""

    @property
    def clocks(self) -> ClockOffsets:
        """How far the clients' clocks are off."""

    @property
    def info_requests(self) -> InfoRequests:
        """Descriptions of the tree and of the server."""

    @property
    def name(self) -> str:
        """The tree's name."""

    @property
    def limits(self) -> Limits:
        """The limits of each request."""

    @property
    def guard(self) -> RequestGuard:
        """Refuses requests before they run."""

    def handle(
        self, request_type: str, payload: bytes, reply_to: ReplyCallback, chunk: str | None = None
    ) -> None:
        """Reply to one request, now or later; never raises."""

    def error(self, error: Exception) -> bytes:
        """The bytes of the reply to a request that failed as a whole."""

    def client_gone(self, client: str) -> None:
        """Release what a client holds that is not connected any more."""

    def add_counters(self, counters: Callable[[], dict[str, int]]) -> None:
        """Let `stats` have the counters of another part of the server too."""

    def stats(self) -> dict[str, int]:
        """The counters of the tree and of the server."""
