"""Tells a server's own messages on its commit stream from those of others.

Access rules keep strangers off the stream's key, but not off keys with wildcards, which Zenoh
delivers as well. Where there are no rules, what contradicts the server is found, and reported.

Thread safety: none; the owner locks, or uses one thread.

Internal: for `zenoh_tf.mirrors.feed`.
"""

from __future__ import annotations

import contextlib
import logging
import time
from typing import Final

from .._net import keys
from ..errors import InvalidArgumentException
from .source import ServerStatus, State

log = logging.getLogger("zenoh_tf.mirror")

#: The least time between two alarms.
_PERIOD_S: Final = 10.0


class StreamSenders:
    """The server instances that the keys of a stream's messages name."""

    def __init__(self, tree: str, interest: str) -> None:
        """`interest`: the id of an interest, or empty."""
        self._tree = tree
        self._interest = interest
        self._known: tuple[str, str | None] = ("", None)  # the last key, and its instance

    def instance(self, key: str) -> str | None:
        """The instance whose stream has exactly this key; None for any other key."""
        known, instance = self._known
        if known != key:
            chunk = key.removeprefix(keys.stream(self._tree, "x")[:-1]).partition("/")[0]
            instance = None
            with contextlib.suppress(InvalidArgumentException):
                named = keys.unescape(chunk)
                if key == keys.stream(self._tree, named, self._interest):
                    instance = named
            self._known = (key, instance)
        return instance


class Alarm:
    """Logs that a copy was given up, at most once in a period."""

    def __init__(self, tree: str) -> None:
        self._tree = tree
        self._count = 0
        self._next_s = 0.0

    def record(self, count: int) -> None:
        """Take how often copies have contradicted the server until now."""
        if count == self._count:
            return
        self._count = count
        if time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + _PERIOD_S
            log.error(
                "the copy of tree %r contradicts its server: another client puts messages on the "
                "server's stream, or replies in its place; the copy is made again (%d times until "
                "now). Keep strangers out with users or certificates: docs/how-to/security.md",
                self._tree,
                count,
            )


def is_ahead(state: State, server: ServerStatus) -> bool:
    """Whether a state, which was there before the server replied, is later than the server's."""
    return state.instance == server.instance and (
        state.clock_ns > server.clock_ns or (server.seq is not None and state.seq > server.seq)
    )
