"""The shared memory of a replica: each copy of the primary's tree has a region and a socket.

Clients of the host read the current copy. When another one replaces it, its lease ends first, so
that no client that has read the new copy reads the old one again.

Thread safety: the thread of the feed; `close` once it has ended.
"""

from __future__ import annotations

import functools
import itertools
import logging
import secrets
from typing import Final

from zenoh_tf import TransformTree, wire
from zenoh_tf._net import handover
from zenoh_tf.mirrors import mirroring

from ..limits import Limits
from ..process.network import NetworkError
from ..process.sharing import Sharing, SharingSettings

#: Snapshots and interests are read from a tree with a log of changes, which nobody writes here.
_LOG_BYTES: Final = 1 << 16

log = logging.getLogger("zenoh_tf.server.sharing")


class SharedCopies:
    """Makes the trees of copies, in shared memory where that is possible."""

    def __init__(self, settings: SharingSettings, tree: str) -> None:
        """Share nothing yet.

        Raises:
            NetworkError: Sharing is required, and there can be no socket.
        """
        self._settings = settings
        self._tree_name = tree
        self._own_id = secrets.token_hex(8)  # the sockets are named after it
        self._numbers = itertools.count()
        self._current: Sharing | None = None
        self._next: Sharing | None = None
        if settings.required:
            self._sharing("").close()

    def make_tree(self, plan: wire.TreeSettings, instance: str) -> TransformTree:
        """An empty tree for a copy. The one that was made before and not shared is given up."""
        if self._next is not None:
            self._next.close()
            self._next = None
        make = functools.partial(mirroring.make_tree, plan, instance, max_log_bytes=_LOG_BYTES)
        try:
            self._next = self._sharing(instance)
            return self._next.make_tree(make)
        except NetworkError as error:
            log.warning("%s: clients read this copy by queries", error)
            return make()

    def share(self, tree: TransformTree, limits: Limits) -> handover.Offer | None:
        """Share the last tree that was made, in place of the one before it. Returns what `hello`
        says of it; None if it is not shared."""
        if self._current is not None:
            self._current.close()
        self._current, self._next = self._next, None
        if self._current is None:
            return None
        try:
            return self._current.start(tree, limits.as_dict())
        except OSError as error:  # such as a socket that somebody has removed
            log.warning("cannot share a copy: %s: clients read it by queries", error)
            self._current.close()
            self._current = None
            return None

    def close(self) -> None:
        """Share nothing any more. May be called again."""
        for sharing in (self._current, self._next):
            if sharing is not None:
                sharing.close()

    def _sharing(self, instance: str) -> Sharing:
        owner = f"{self._own_id}-{next(self._numbers)}"
        return Sharing(self._settings, self._tree_name, instance, owner=owner)
