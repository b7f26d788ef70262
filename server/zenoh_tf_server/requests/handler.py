"""The client that asks, the handler of its request, and the callbacks for the reply."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final, Protocol

from zenoh_tf import wire
from zenoh_tf.errors import TransformException

from ..ingest.clock_offsets import ClockOffsets
from ..limits import Limits
from .counters import RequestCounters
from .guard import RequestGuard
from .info import InfoRequests

log = logging.getLogger("zenoh_tf.server")

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


class Handler(ABC):
    """Serves the requests to one tree: the server's `Service`, or a replica's."""

    #: How far the clients' clocks are off.
    clocks: ClockOffsets
    #: Descriptions of the tree and of the server.
    info_requests: InfoRequests

    def __init__(self, name: str, limits: Limits, guard: RequestGuard) -> None:
        """`name`: the tree's."""
        self.name = name
        self.limits = limits
        self.guard = guard
        self.requests = RequestCounters()
        self._more_counters: list[Callable[[], dict[str, int]]] = []

    @property
    @abstractmethod
    def instance(self) -> str:
        """The server instance that replies name."""

    @property
    def age_s(self) -> float | None:
        """Of a replica: how old what is served may be, in seconds."""
        return None

    @abstractmethod
    def handle(
        self, request_type: str, payload: bytes, reply_to: ReplyCallback, chunk: str | None = None
    ) -> None:
        """Reply to one request, now or later. Never raises: an error is the reply.

        `chunk` is what stands behind the request type in the query's key.
        """

    @abstractmethod
    def client_gone(self, client: str) -> None:
        """Release what a client holds that is not connected any more."""

    @abstractmethod
    def stats(self) -> dict[str, int]:
        """The counters of the tree and of the server; `metric_table` declares each key."""

    def error(self, error: Exception) -> bytes:
        """The bytes of the reply to a request that failed as a whole."""
        typed = typed_error(error)
        self.requests.failed(type(typed).__name__)
        return wire.pack(self._error_reply(typed))

    def add_counters(self, counters: Callable[[], dict[str, int]]) -> None:
        """Let `stats` have the counters of another part of the server too."""
        self._more_counters.append(counters)

    def _error_reply(self, error: TransformException) -> wire.Message:
        return wire.error_reply(self.instance, error)

    def _added_counters(self) -> dict[str, int]:
        return {name: count for more in self._more_counters for name, count in more().items()}


def typed_error(error: Exception) -> TransformException:
    """The error as a client gets it. One that no request should cause is logged."""
    if not isinstance(error, (TransformException, TypeError, ValueError, OverflowError)):
        log.exception("internal error while serving a request", exc_info=error)
    return wire.as_transform_exception(error)
