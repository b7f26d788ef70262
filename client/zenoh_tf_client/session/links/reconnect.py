"""Connects a client again that has several endpoints, as soon as the tree is not at its own.

Zenoh reports at once when a link breaks, when the server or router at its other end stops, and,
after its lease of 3 s, when that end is frozen or cut off. A router reports in the same way when it
has lost its server: the server's liveliness token is gone. A thread looks for such reports.

Thread safety: all functions.
"""

from __future__ import annotations

import logging
import threading
import weakref
from typing import Final, Protocol

from zenoh_tf import threads
from zenoh_tf.errors import ServerUnavailable

log = logging.getLogger("zenoh_tf.client")

#: How often the thread looks, and the longest pause between two rounds through the list.
_PERIOD_S: Final = 0.1
_LONGEST_S: Final = 1.0


class Movable(Protocol):
    """What is connected again."""

    def move_if_lost(self) -> bool:
        """Connect again if the link is lost. False: nothing answers. Raises ServerUnavailable if it
        is closed."""


def start(connection: Movable, closed: threading.Event) -> None:
    """Look after a connection until it is closed or collected."""
    threads.start("reconnect", _follow, weakref.ref(connection), closed)


def _follow(connection_ref: weakref.ref[Movable], closed: threading.Event) -> None:
    pause_s = _PERIOD_S
    while not closed.wait(pause_s):
        connection = connection_ref()
        if connection is None:
            return
        is_there = True
        try:
            is_there = connection.move_if_lost()
        except ServerUnavailable:  # the connection is closed, or the program is ending
            return
        except Exception:  # no error may end it
            log.exception("internal error while connecting again")
        del connection  # or the wait would keep it alive
        pause_s = _PERIOD_S if is_there else min(2 * pause_s, _LONGEST_S)
