"""Tells a server's own messages on its commit stream from those of others.

Access rules keep strangers off the stream's key, but not off keys with wildcards, which Zenoh
delivers as well. Where there are no rules, what contradicts the server is found, and reported.

Thread safety: none; the owner locks, or uses one thread.

Internal: for `zenoh_tf.mirrors.feed`.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import time
from collections.abc import Callable
from typing import Final

from .._net import keys
from ..errors import InvalidArgumentException
from .source import ServerStatus, State

log = logging.getLogger("zenoh_tf.mirror")

#: The least time between two alarms.
_PERIOD_S: Final = 10.0


def senders(tree: str, interest: str) -> Callable[[str], str | None]:
    """A function from a key to the server instance whose stream, of a tree and the id of an
    interest or "", has exactly this key; to None from any other key."""

    @functools.lru_cache(maxsize=1)  # messages in a row have one key
    def sender(key: str) -> str | None:
        chunk = key.removeprefix(keys.stream(tree, "x")[:-1]).partition("/")[0]
        with contextlib.suppress(InvalidArgumentException):
            instance = keys.unescape(chunk)
            if key == keys.stream(tree, instance, interest):
                return instance
        return None

    return sender


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
