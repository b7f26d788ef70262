"""Frees what Zenoh's router keeps of publishers that are gone.

A publisher declares its key. The router of Zenoh 1.10 forgets the key if the publisher closes
before its session. If the session ends first, or its process is killed, the router keeps 2.5 kB of
the key for good. It checks again whether anybody needs a key when a token under that key goes, so
this server declares and removes one, in about 10 us. A key that a publisher still has stays.

As in eclipse-zenoh/zenoh#1518, where the memory of a publisher's key is not released either.
Without this, each authority that is never seen again cost 5 kB, as a broadcaster has two keys.

Thread safety: all methods.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Final

import zenoh

from .._net import keys
from ..threads import Periodic

#: Keys are checked this often, if a client has gone since.
_PERIOD_S: Final = 30.0
#: The thread pauses after so many authorities, as each token locks the routing tables for a moment.
_AT_ONCE: Final = 16
_PAUSE_S: Final = 0.002


class AbandonedKeys(Periodic):
    """Frees the keys of authorities whose publishers are gone."""

    def __init__(
        self, session: zenoh.Session, tree: str, authorities: Callable[[], Iterable[str]]
    ) -> None:
        """`session`: that of the router. `authorities`: those that have published."""
        super().__init__("abandoned-keys", self._free_if_gone, _PERIOD_S)
        self._session = session
        self._tree = tree
        self._authorities = authorities
        self._gone = threading.Event()

    def client_gone(self, client: str) -> None:
        """Free the keys of a client's publishers at the next period: it is gone."""
        self._gone.set()

    def free(self) -> None:
        """Free the keys that nobody publishes on any more."""
        tokens = self._session.liveliness()
        for count, authority in enumerate(self._authorities(), 1):
            for static in (False, True):  # a broadcaster declares both
                tokens.declare_token(keys.put(self._tree, authority, static=static)).undeclare()
            if count % _AT_ONCE == 0 and self.pause(_PAUSE_S):
                return

    def _free_if_gone(self) -> None:
        if self._gone.is_set():
            self._gone.clear()
            self.free()
