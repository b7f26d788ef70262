"""A site's server gathers the trees of robots (``--mirror-of``).

`settings` has the flags, `discovery` finds robots on the site's network, whose messages
`shared_streams` receives; `robot` listens to one robot, `pool` has the threads of all, and `rows`
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
from . import quota
from .discovery import Discovery
from .pool import Pool
from .robot import Robot
from .settings import FederationSettings, RobotAddress, RobotPattern
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
        self, settings: FederationSettings, security: Security, service: Service, ingest: Ingest
    ) -> None:
        limits = service.limits
        self._service = service
        self._settings = settings
        self._most = limits.robots
        expected = len(settings.links) + (limits.robots if settings.patterns else 0)
        self._pool = Pool(ingest)
        self._make = functools.partial(
            Robot,
            shared=settings.shared,
            credentials=security.credentials,
            limits=limits,
            service=service,
            share=quota.default_share(limits, expected),
            pool=self._pool,
        )
        #: By name. Robots are added, and stay.
        self._robots = {address.name: self._make(address) for address in settings.links}
        self._discovery: Discovery | None = None
        self._sums: Mapping[str, Mapping[str, int]] = {}
        self._sums_until_s = 0.0

    def start(self, session: zenoh.Session) -> None:
        """Connect to each robot, find others on the session's network, and begin to listen."""
        for robot in self._robots.values():
            robot.start()

        patterns = self._settings.patterns
        streams = {pattern: SharedStreams(session, pattern) for pattern in patterns}

        def found(address: RobotAddress, pattern: RobotPattern) -> None:
            if address.name not in self._robots:
                self._robots[address.name] = robot = self._make(address)
                robot.start(session, streams[pattern])

        for each in streams.values():
            self._pool.add_streams(each)
        if patterns:
            self._discovery = Discovery(session, patterns, self._service.name, self._most, found)

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


def start(
    settings: FederationSettings,
    security: Security,
    service: Service,
    ingest: Ingest,
    session: zenoh.Session,
    stack: ExitStack,
) -> None:
    """Gather the trees of robots, until the stack is closed."""
    if settings.links or settings.patterns:
        robots = Robots(settings, security, service, ingest)
        stack.callback(robots.close)
        robots.start(session)
        service.add_counters(robots.counters)
