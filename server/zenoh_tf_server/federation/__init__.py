"""A site's server gathers the trees of robots (``--mirror-of``).

`settings` has the flags; `discovery` finds robots on the site's network; `shared_streams` receives
their messages; `robot` listens to one robot, `pool` has the threads of all, and `rows`
turns changes into puts.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, Final

import zenoh

from ..ingest.ingest import Ingest
from ..requests.service import Service
from ..security.settings import Security
from . import quota, shared_streams
from .discovery import Discovery
from .pool import Pool
from .robot import RobotTree
from .settings import FederationSettings, RobotPattern
from .shared_streams import SharedStreams

#: The tree's authorities are read at most this often.
_REFRESH_S: Final = 1.0
#: Fields of an authority's record that are summed for its robot.
_SUMMED: Final = ("stored", "dropped", "refused", "dropped_by_queue")
_NONE: Final = dict.fromkeys(_SUMMED, 0)


class Robots:
    """All robots of a server, until `close`.

    Thread safety: all methods.
    """

    def __init__(
        self,
        settings: FederationSettings,
        security: Security,
        service: Service,
        ingest: Ingest,
        robots: dict[str, RobotTree],
    ) -> None:
        """`robots`: all robots by their names, from now on."""
        limits = service.limits
        self._service = service
        self._settings = settings
        self._most = limits.robots
        expected = len(settings.links) + (limits.robots if settings.patterns else 0)
        self._pool = Pool(ingest, limits.robot_bytes)
        self._make = functools.partial(
            RobotTree,
            shared=settings.shared,
            credentials=security.credentials,
            service=service,
            share=quota.default_share(limits, expected),
            pool=self._pool,
        )
        self._robots = robots  # `discovery` adds others
        self._robots |= {address.name: self._make(address) for address in settings.links}
        self._discovery: Discovery | None = None
        self._sums: Mapping[str, Mapping[str, int]] = {}
        self._sums_until_s = 0.0

    def start(self, session: zenoh.Session) -> None:
        """Connect to each robot, find others on the session's network, and begin to listen."""
        for robot in self._robots.values():
            robot.start()
        patterns: dict[RobotPattern, SharedStreams] = {}
        for pattern in self._settings.patterns:
            patterns[pattern] = shared_streams.of_pattern(session, pattern, self._pool.room)
            self._pool.add_streams(patterns[pattern])
        if patterns:
            self._discovery = Discovery(
                self._service.name, patterns, self._robots, self._most, self._make
            )
            self._discovery.start(session, self._pool)

    def close(self) -> None:
        """Listen no more."""
        if self._discovery is not None:
            self._discovery.close()
        for robot in list(self._robots.values()):
            robot.close()
        self._pool.close()

    def counters(self) -> dict[str, Any]:
        """Counters for `stats`: FIELD/ROBOT, in `metric_table.FROM_ROBOTS`."""
        now_s = time.monotonic()
        if now_s >= self._sums_until_s:
            self._sums, self._sums_until_s = self._sum(), now_s + _REFRESH_S
        sums = self._sums
        return {
            f"robot_{field}/{name}": value
            for name, robot in list(self._robots.items())
            for field, value in {**robot.counters(), **sums.get(name, _NONE)}.items()
        }

    def _sum(self) -> dict[str, dict[str, int]]:
        sums = {name: dict(_NONE) for name in list(self._robots)}
        for record in self._service.info_requests.authorities():
            robot, colon, _ = record["name"].partition(":")
            if colon and robot in sums:
                for field in _SUMMED:
                    sums[robot][field] += record[field]
        return sums


def lost(robots: Mapping[str, RobotTree]) -> dict[str, float]:
    """The robots that are not heard, and for how many seconds."""
    found = ((name, robot.lost_s) for name, robot in list(robots.items()))
    return {name: lost_s for name, lost_s in found if lost_s is not None}


def start(
    settings: FederationSettings,
    security: Security,
    service: Service,
    ingest: Ingest,
    session: zenoh.Session,
    stack: ExitStack,
    robots: dict[str, RobotTree],
) -> None:
    """Gather the trees of robots, until the stack is closed. `robots`: them by their names, from
    now on."""
    if settings.links or settings.patterns:
        gathered = Robots(settings, security, service, ingest, robots)
        stack.callback(gathered.close)
        gathered.start(session)
        service.add_counters(gathered.counters)
