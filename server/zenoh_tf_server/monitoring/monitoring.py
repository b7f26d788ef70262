"""What an operator sees of a running server: health, metrics, and messages to systemd."""

from __future__ import annotations

import logging
from typing import Final

from zenoh_tf.text import quoted

from ..limits import Limits
from ..transport.running_server import RunningServer
from . import service_manager
from .health import PERIOD_S, Health
from .metrics import Metrics
from .status_port import Page, StatusPort

log = logging.getLogger("zenoh_tf.server")

#: Probes per time-out of systemd's watchdog.
_PROBES_PER_WATCHDOG: Final = 3.0


class Monitoring:
    """Listens for Prometheus from construction to the process's end, also while no server is
    there yet."""

    def __init__(self, metrics: tuple[str, int] | None, limits: Limits) -> None:
        """`metrics`: the host and port where they are served; None: nowhere. Raises NetworkError or
        MetricsMissing."""
        watchdog_s = service_manager.watchdog_s()
        period_s = min(PERIOD_S, (watchdog_s or PERIOD_S * 9) / _PROBES_PER_WATCHDOG)
        self._health = Health(period_s)
        # The answer to a probe proves that the service works, which a timer would not.
        if watchdog_s is not None:
            self._health.answered = lambda: service_manager.notify(WATCHDOG=1)
        self._probes = watchdog_s is not None or metrics is not None
        self._server: RunningServer | None = None
        self._metrics: Metrics | None = None
        self._port: StatusPort | None = None
        if metrics is not None:
            self._metrics = found = Metrics(self._health, limits.metrics_authorities)
            pages = {
                "/metrics": lambda: Page(200, found.page(), found.content_type),
                "/healthz": self._healthz,
                "/readyz": self._readyz,
            }
            self._port = StatusPort(metrics, pages)

    def serving(self, server: RunningServer) -> None:
        """The tree is claimed and served."""
        self._server = server
        if self._metrics is not None:
            self._metrics.serving(server)
        tree = server.service.name
        service_manager.notify(READY=1, STATUS=f"serves tree {quoted(tree)}")
        if self._probes:  # after READY: before it, systemd expects no WATCHDOG=1
            self._health.serving(server)
        log.info(
            "instance %s serves tree %s",
            server.service.instance,
            quoted(tree),
            extra={"tree": tree, "instance": server.service.instance},
        )
        if self._port is not None:
            log.info("metrics on port %d", self._port.port, extra={"port": self._port.port})

    def stopping(self) -> None:
        """The server is about to close."""
        service_manager.notify(STOPPING=1)
        self._health.stopping()

    def _healthz(self) -> Page:
        if self._health.healthy or not self._health.ready:  # a start may be slow
            return Page(200, b"ok\n" + self._age())
        return Page(503, b"unhealthy: no worker has answered the latest probe lookups\n")

    def _readyz(self) -> Page:
        if self._health.ready:
            return Page(200, b"ready\n" + self._age())
        return Page(503, b"not ready: the tree is not served\n")

    def _age(self) -> bytes:
        """How old the state is that a replica serves; empty for another server."""
        age_s = None if self._server is None else self._server.service.age_s
        return b"" if age_s is None else f"replica, {age_s:.1f} s old\n".encode()
