"""Finds robots on the site's own network, by the liveliness tokens of their servers.

Anyone can declare tokens, so one alone costs little and gets nothing: only some of the trees that
have sent no copy yet are asked at a time, by turns, and none without a token. A robot has a place
once its copy is complete, and loses it if it leaves without having had a frame here. With frames it
keeps it until the server ends: none gets another share of frames by returning.

Thread safety: all methods.
"""

from __future__ import annotations

import asyncio
import functools
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import zenoh

from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException

from ..rate_limited_log import RateLimitedLog
from .pool import Pool
from .robot import RobotTree
from .settings import RobotAddress, RobotPattern
from .shared_streams import SharedStreams

#: Trees without a copy that are asked at a time, and for how long if others wait for their turn:
#: without any answer, and without a complete copy.
_ASKED: Final = 256
_TURN_S: Final = 3.0
_LONGEST_TURN_S: Final = 60.0
_PERIOD_S: Final = 0.5
#: Trees that are known, for each place.
_KNOWN: Final = 8

log = logging.getLogger("zenoh_tf.server.federation")


@dataclass(eq=False, slots=True)
class _Tree:
    """A tree that a pattern has found."""

    address: RobotAddress
    streams: SharedStreams
    instances: set[str] = field(default_factory=set)  # of its servers that have tokens
    robot: RobotTree | None = None  # once it is asked
    since_s: float = 0.0


class Discovery:
    """The robots that patterns find."""

    def __init__(
        self,
        own_tree: str,
        patterns: dict[RobotPattern, SharedStreams],
        robots: dict[str, RobotTree],
        most: int,
        make: Callable[..., RobotTree],
    ) -> None:
        """`robots`: by name; those that are found are added, up to so many. `make` makes one."""
        self._own_tree = own_tree
        self._patterns = patterns
        self._robots = robots
        self._listed = frozenset(robots)
        self._most = most
        self._make = make
        self._log = RateLimitedLog(log)
        self._lock = threading.Lock()
        # Guarded by the lock.
        self._trees: dict[str, _Tree] = {}
        self._names: dict[str, str] = {}  # which tree has a name
        self._asked: dict[_Tree, None] = {}  # that have no complete copy yet; the first is next
        self._waiting: deque[_Tree] = deque()  # for their turn
        self._left_out: set[str] = set()  # trees whose names others have
        self._subscriber: zenoh.Subscriber[Any] | None = None

    def start(self, session: zenoh.Session, pool: Pool) -> None:
        """Begin to find robots."""
        self._session = session
        self._subscriber = session.liveliness().declare_subscriber(
            keys.all_servers(), self._token_changed, history=True
        )
        pool.spawn(self._take_turns())

    def close(self) -> None:
        """Find no more."""
        if self._subscriber is not None:
            self._subscriber.undeclare()

    def _token_changed(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        try:
            tree, instance = keys.tree_name(key), keys.last_name(key)
        except InvalidArgumentException:  # a token that no server of ours declares
            return
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._came(tree, instance)
            else:
                self._went(tree, instance)
            self._ask_next()

    def _came(self, tree: str, instance: str) -> None:
        found = self._trees.get(tree) or self._add(tree)
        if found is not None:
            found.instances.add(instance)

    def _add(self, tree: str) -> _Tree | None:
        """A tree that is new here; None if it is no robot's, or there is no place for it."""
        if tree == self._own_tree:
            return None
        names = ((pattern, pattern.robot_of(tree)) for pattern in self._patterns)
        pattern, name = next((each for each in names if each[1] is not None), (None, None))
        if pattern is None or name is None:
            return None
        if name in self._listed or self._names.get(name, tree) != tree:
            self._leave_out(tree, name)
            return None
        if len(self._trees) >= _KNOWN * self._most:
            self._log.warn("trees", f"robot {name!r} is left out: {len(self._trees):,} are known")
            return None
        address = RobotAddress(name, "", tree, pattern.share)
        found = _Tree(address, self._patterns[pattern])
        self._trees[tree], self._names[name] = found, tree
        self._waiting.append(found)
        return found

    def _leave_out(self, tree: str, name: str) -> None:
        if tree in self._left_out or len(self._left_out) >= self._most:
            return
        self._left_out.add(tree)
        other = "a robot that is listed" if name in self._listed else f"tree {self._names[name]!r}"
        log.warning(
            "tree %r is left out: %s is called %r already; give the robots different names",
            tree,
            other,
            name,
        )

    def _went(self, tree: str, instance: str) -> None:
        self._left_out.discard(tree)
        found = self._trees.get(tree)
        if found is None:
            return
        found.instances.discard(instance)
        if not found.instances and (found.robot is None or not found.robot.has_frames):
            self._forget(found)

    def _forget(self, found: _Tree) -> None:
        self._stop(found)
        if found in self._waiting:
            self._waiting.remove(found)
        del self._trees[found.address.tree], self._names[found.address.name]

    def _stop(self, found: _Tree) -> None:
        """Ask it no more."""
        self._asked.pop(found, None)
        if found.robot is not None:
            self._robots.pop(found.address.name, None)
            found.robot.close()
            found.robot = None

    def _ask_next(self) -> None:
        """Ask the trees whose turn it is. Requires the lock."""
        while self._waiting and len(self._asked) < _ASKED:
            name = self._waiting[0].address.name
            if len(self._robots) - len(self._listed) >= self._most:
                self._log.warn(
                    "robots",
                    f"robot {name!r} is left out: {self._most:,} robots were found, which is the "
                    "limit (--limit robots=N)",
                )
                return
            found = self._waiting.popleft()
            is_there = functools.partial(bool, found.instances)
            robot = self._make(found.address, is_there=is_there, is_found=True)
            self._robots[name] = found.robot = robot
            self._asked[found] = None
            found.since_s = time.monotonic()
            log.debug("robot %r: found tree %r on this network", name, found.address.tree)
            robot.start(self._session, found.streams)

    async def _take_turns(self) -> None:
        """Let others have the turn of those that do not answer."""
        while True:
            await asyncio.sleep(_PERIOD_S)
            with self._lock:
                now_s = time.monotonic()
                for found in list(self._asked):
                    robot, asked_s = found.robot, now_s - found.since_s
                    if robot is None or robot.has_copy:
                        del self._asked[found]
                    elif self._waiting and asked_s > (
                        _LONGEST_TURN_S if robot.is_answered else _TURN_S
                    ):
                        self._stop(found)
                        self._waiting.append(found)
                self._ask_next()
