"""Where the feed of a mirror listens and asks: the connection of its client.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
from typing import Any

import zenoh
from zenoh.handlers import RingChannel

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf._zenoh.calls import SessionCalls, is_forked
from zenoh_tf.errors import ServerBusy
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.mirrors.source import ServerStatus, State
from zenoh_tf.steps import Ask, Pause, Steps

from ..publish.publisher import undeclare_unless_closed
from ..requests.request import Call
from ..session.connection import Connection


class MirrorSource:
    """The `zenoh_tf.mirrors.feed.Source` of a client."""

    def __init__(self, connection: Connection, interest: wire.Interest | None = None) -> None:
        self._connection = connection
        self._key = keys.streams(connection.tree, interest.id if interest else "")
        #: Kept here for `SessionCalls.never_free`.
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        #: The feed itself, once it has begun.
        self.feed: MirrorFeed | None = None

    @property
    def tree(self) -> str:
        """The tree's name."""
        return self._connection.tree

    @property
    def calls(self) -> SessionCalls:
        """To be entered while a message is waited for."""
        return self._connection.calls

    def subscribe(self, channel: RingChannel[zenoh.Sample]) -> zenoh.Subscriber[Any]:
        """Listen to the stream; see `Source`."""
        connection = self._connection
        connection.calls.add_owner(self)
        with connection.calls:
            subscriber = connection.session.declare_subscriber(self._key, channel)
        self._subscribers.append(subscriber)
        return subscriber

    def unsubscribe(self, subscriber: zenoh.Subscriber[Any]) -> bool:
        """Undeclare a subscriber; see `Source`."""
        if is_forked():
            return False
        undeclare_unless_closed(subscriber.undeclare, self._connection.calls)
        with contextlib.suppress(ValueError):  # undeclared before
            self._subscribers.remove(subscriber)
        return True

    def ask(self, request_type: str, body: wire.Message, wait_s: float) -> Steps[wire.Message]:
        """Send a request; see `Source`."""
        if self._connection.moves:  # the next server may be behind the last one
            body = body | wire.floor_field(*self._seen())
        return self._connection.steps(Call(request_type, body, lambda reply: reply, wait_s))

    def status(self) -> Steps[ServerStatus]:
        """Ask the server for its instance id, its clock and its last commit."""
        server = yield from self._connection.greet()
        instance, seq = self._seen()
        if server.primary is not None and server.instance == instance and (server.seq or 0) < seq:
            raise ServerBusy(f"the server has commit {server.seq}, and the mirror {seq}: it waits")
        return ServerStatus(server.instance, server.clock_ns, server.seq, server.real_ns)

    def take(self, step: Ask | Pause) -> object:
        """Take a step; see `Source`."""
        return self._connection.take(step)

    def _seen(self) -> tuple[str, int]:
        """The last commit that the mirror has, and its server instance; "" before the first."""
        state = State() if self.feed is None else self.feed.state
        return state.instance, state.seq
