"""Finds robots on the server's own network by the liveliness tokens of their servers.

Any session on the network can declare such tokens, so their number is limited, and a robot that was
found keeps its place until the server ends: no one gets another share of frames by returning.

Thread safety: all methods.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Final

import zenoh

from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException

from ..rate_limited_log import RateLimitedLog
from .settings import RobotAddress, RobotPattern

log: Final = logging.getLogger("zenoh_tf.server.federation")


class Discovery:
    """Reports each robot once, from its creation until `close`."""

    def __init__(
        self,
        session: zenoh.Session,
        patterns: Sequence[RobotPattern],
        own_tree: str,
        most: int,
        found: Callable[[RobotAddress, RobotPattern], None],
    ) -> None:
        """`most`: how many robots are reported. `found` gets each, with an empty endpoint: it is
        reached over the session, and the pattern that it matches."""
        self._patterns = patterns
        self._own_tree = own_tree
        self._most = most
        self._found = found
        self._log = RateLimitedLog(log)
        self._lock = threading.Lock()
        self._names: set[str] = set()
        self._subscriber = session.liveliness().declare_subscriber(
            keys.all_servers(), self._changed, history=True
        )

    def close(self) -> None:
        """Report no more."""
        self._subscriber.undeclare()

    def _changed(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        try:
            tree = keys.tree_name(str(sample.key_expr))
        except InvalidArgumentException:  # a token that no server of ours declares
            return
        if tree == self._own_tree:
            return
        for pattern in self._patterns:
            name = pattern.robot_of(tree)
            if name is not None:
                self._report(RobotAddress(name, "", tree, pattern.share), pattern)
                return

    def _report(self, address: RobotAddress, pattern: RobotPattern) -> None:
        with self._lock:
            if address.name in self._names:
                return
            if len(self._names) >= self._most:
                self._log.warn(
                    "robots",
                    f"robot {address.name!r} is left out: {self._most:,} robots were found, which "
                    "is the limit (--limit robots=N)",
                )
                return
            self._names.add(address.name)
        log.info("robot %r: found tree %r on this network", address.name, address.tree)
        self._found(address, pattern)
