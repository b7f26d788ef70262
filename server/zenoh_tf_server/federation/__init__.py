"""A site's server gathers the trees of robots (``--mirror-of``).

`settings` has the flags, `robot` listens to one robot, `pool` has the threads of all, and `rows`
turns changes into puts.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, Final

from ..ingest.ingest import Ingest
from ..limits import Limits
from ..requests.service import Service
from ..security.settings import Security
from . import quota
from .pool import Pool
from .robot import Robot
from .settings import FederationSettings

#: The tree's authorities are read at most this often.
_REFRESH_S: Final = 1.0
#: Fields of an authority's record that are summed for its robot.
_SUMMED: Final = ("stored", "dropped", "refused", "dropped_by_queue")


class Robots:
    """All robots of a server, until `close`.

    Thread safety: all methods.
    """

    def __init__(
        self, settings: FederationSettings, security: Security, limits: Limits, service: Service
    ) -> None:
        self._service = service
        share = quota.default_share(limits, len(settings.links))
        self._pool = Pool()
        self._robots = [
            Robot(
                address,
                settings.shared,
                security.credentials,
                limits,
                service,
                share,
                self._pool,
            )
            for address in settings.links
        ]
        self._sums: Mapping[str, Mapping[str, int]] = {}
        self._sums_until_s = 0.0

    def start(self, ingest: Ingest) -> None:
        """Connect to each robot, and begin to listen."""
        self._pool.start()
        for robot in self._robots:
            robot.start(ingest)

    def close(self) -> None:
        """Listen no more."""
        for robot in self._robots:
            robot.close()
        self._pool.close()

    def counters(self) -> dict[str, Any]:
        """Counters for `stats`: FIELD/ROBOT, in `metric_table.FROM_ROBOTS`."""
        now_s = time.monotonic()
        if now_s >= self._sums_until_s:
            self._sums, self._sums_until_s = self._sum(), now_s + _REFRESH_S
        sums = self._sums
        return {
            f"robot_{field}/{robot.name}": value
            for robot in self._robots
            for field, value in {**robot.counters(), **sums[robot.name]}.items()
        }

    def _sum(self) -> dict[str, dict[str, int]]:
        sums = {robot.name: dict.fromkeys(_SUMMED, 0) for robot in self._robots}
        for record in self._service.info_requests.authorities():
            robot, colon, _ = record["name"].partition(":")
            if colon and robot in sums:
                for field in _SUMMED:
                    sums[robot][field] += record[field]
        return sums


def start(
    settings: FederationSettings,
    security: Security,
    limits: Limits,
    service: Service,
    ingest: Ingest,
    stack: ExitStack,
) -> None:
    """Gather the trees of robots, until the stack is closed."""
    if settings.links:
        robots = Robots(settings, security, limits, service)
        stack.callback(robots.close)
        robots.start(ingest)
        service.add_counters(robots.counters)
