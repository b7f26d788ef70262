"""A site's server gathers the trees of robots (``--mirror-of``).

`settings` has the flags; `Robots` finds robots on the site's network, whose messages
`shared_streams` receives; `robot` listens to one robot, `pool` has the threads of all, and `rows`
turns changes into puts.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, Final

import zenoh

from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException

from ..ingest.ingest import Ingest
from ..rate_limited_log import RateLimitedLog
from ..requests.service import Service
from ..security.settings import Security
from . import quota
from .pool import Pool
from .robot import Robot
from .settings import FederationSettings, RobotAddress, RobotPattern
from .shared_streams import SharedStreams

#: The tree's authorities are read at most this often.
_REFRESH_S: Final = 1.0
#: Fields of an authority's record that are summed for its robot.
_SUMMED: Final = ("stored", "dropped", "refused", "dropped_by_queue")
_NONE: Final = dict.fromkeys(_SUMMED, 0)

log = logging.getLogger("zenoh_tf.server.federation")


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
            service=service,
            share=quota.default_share(limits, expected),
            pool=self._pool,
        )
        #: By name. Robots are added, and stay.
        self._robots = {address.name: self._make(address) for address in settings.links}
        self._lock = threading.Lock()  # of additions
        self._streams: dict[RobotPattern, SharedStreams] = {}
        self._subscriber: zenoh.Subscriber[Any] | None = None
        self._log = RateLimitedLog(log)
        self._sums: Mapping[str, Mapping[str, int]] = {}
        self._sums_until_s = 0.0

    def start(self, session: zenoh.Session) -> None:
        """Connect to each robot, find others on the session's network, and begin to listen."""
        self._session = session
        for robot in self._robots.values():
            robot.start()
        for pattern in self._settings.patterns:
            self._streams[pattern] = streams = SharedStreams(session, pattern)
            self._pool.add_streams(streams)
        if self._streams:
            self._subscriber = session.liveliness().declare_subscriber(
                keys.all_servers(), self._token_changed, history=True
            )

    def close(self) -> None:
        """Listen no more."""
        if self._subscriber is not None:
            self._subscriber.undeclare()
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

    # --- robots on the server's own network, by the liveliness tokens of their servers

    def _token_changed(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        try:
            tree = keys.tree_name(str(sample.key_expr))
        except InvalidArgumentException:  # a token that no server of ours declares
            return
        if tree == self._service.name:
            return
        for pattern in self._settings.patterns:
            name = pattern.robot_of(tree)
            if name is not None:
                self._add(RobotAddress(name, "", tree, pattern.share), self._streams[pattern])
                return

    def _add(self, address: RobotAddress, streams: SharedStreams) -> None:
        """Listen to a robot that was found. Any session can declare tokens, so the number of robots
        is limited, and each keeps its place until the server ends: none gets another share of
        frames by returning."""
        name = address.name
        with self._lock:
            if name in self._robots:
                return
            if len(self._robots) - len(self._settings.links) >= self._most:
                self._log.warn(
                    "robots",
                    f"robot {name!r} is left out: {self._most:,} robots were found, which is the "
                    "limit (--limit robots=N)",
                )
                return
            self._robots[name] = robot = self._make(address)
        log.info("robot %r: found tree %r on this network", name, address.tree)
        robot.start(self._session, streams)


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
