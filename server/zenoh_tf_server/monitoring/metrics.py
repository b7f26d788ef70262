"""The server's metrics for Prometheus, read from the running server when they are asked for.

Needs prometheus-client, the extra ``zenoh-tf[metrics]``.

Thread safety: all methods.
"""

from __future__ import annotations

import platform
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import admission
from zenoh_tf.introspection import metric_table
from zenoh_tf.introspection.metric_table import FROM_AUTHORITIES, FROM_ROBOTS, FROM_STATS, Metric
from zenoh_tf.text import cut, printable
from zenoh_tf.text.extras import pip_install

from ..requests.counters import OK, buckets
from ..transport.running_server import RunningServer

if TYPE_CHECKING:
    from prometheus_client.metrics_core import Metric as Family

    from .health import Health

#: The tree is read at most this often: that costs time that grows with the number of frames.
_REFRESH_S: Final = 1.0
_MAX_LABEL_CHARS: Final = 100

Value = tuple[Metric, tuple[str, ...], Any]


class MetricsMissing(Exception):
    """prometheus-client is not installed; the message is one line for the user."""


class Metrics:
    """A registry of its own with the server's metrics and those of the process."""

    def __init__(self, health: Health, max_authorities: int) -> None:
        """Raises MetricsMissing."""
        try:
            import prometheus_client  # noqa: PLC0415
            from prometheus_client import metrics_core  # noqa: PLC0415
        except ImportError as error:
            raise MetricsMissing(
                f"--metrics needs prometheus-client: {pip_install('metrics')}"
            ) from error
        self._families: Any = metrics_core
        self._generate: Callable[[Any], bytes] = prometheus_client.generate_latest
        self.content_type: str = prometheus_client.CONTENT_TYPE_LATEST
        self._registry = prometheus_client.CollectorRegistry(auto_describe=False)
        self._registry.register(self)
        prometheus_client.ProcessCollector(registry=self._registry)
        self._health = health
        self._server: RunningServer | None = None
        self._max_authorities = max_authorities
        self._authorities: set[str] = set()  # those that have series
        self._lock = threading.Lock()
        self._page = b""
        self._page_until_s = 0.0

    def serving(self, server: RunningServer) -> None:
        """Read this server from now on."""
        with self._lock:
            self._server = server
            self._page_until_s = 0.0

    def page(self) -> bytes:
        """All metrics in Prometheus' text format."""
        with self._lock:
            if time.monotonic() >= self._page_until_s:
                self._page = self._generate(self._registry)
                self._page_until_s = time.monotonic() + _REFRESH_S
            return self._page

    def collect(self) -> Iterable[Family]:
        """The metric families; the registry calls this."""
        families: dict[str, Family] = {}
        for metric, labels, value in self._values():
            family = families.get(metric.name)
            if family is None:
                family = families[metric.name] = self._family(metric)
            if metric.kind == "histogram":
                pairs, sum_s = buckets(value)
                family.add_metric(labels, buckets=pairs, sum_value=sum_s)  # type: ignore[attr-defined]
            else:
                family.add_metric(labels, value)  # type: ignore[attr-defined]
        return families.values()

    def _family(self, metric: Metric) -> Family:
        kinds = {
            "counter": self._families.CounterMetricFamily,
            "gauge": self._families.GaugeMetricFamily,
            "histogram": self._families.HistogramMetricFamily,
        }
        family: Family = kinds[metric.kind](metric.full_name, metric.meaning, labels=metric.labels)
        return family

    def _values(self) -> Iterator[Value]:
        yield metric_table.READY, (), float(self._health.ready)
        yield metric_table.HEALTHY, (), float(self._health.healthy)
        yield metric_table.PROBE, (), self._health.probe_duration_s
        yield metric_table.THREADS, (), float(threading.active_count())
        server = self._server
        if server is None:
            return
        service = server.service
        labels = (service.name, server.service.instance)
        what_runs = (version("zenoh-tf"), platform.python_version(), version("eclipse-zenoh"))
        yield metric_table.BUILD, (*what_runs, *map(printable, labels)), 1.0
        yield metric_table.CLIENTS, (), float(len(server.clients))
        ahead_s, behind_s = service.clocks.worst_clients_s()
        yield metric_table.CLIENT_AHEAD, (), ahead_s
        yield metric_table.CLIENT_BEHIND, (), behind_s
        for name, limit in service.limits.as_dict().items():
            yield metric_table.LIMIT, (name,), float(limit)
        yield from _from_stats(service.stats())
        yield from self._from_authorities(service.info_requests.authorities())
        yield from _from_requests(server)

    def _from_authorities(self, records: Sequence[Mapping[str, Any]]) -> Iterator[Value]:
        """Values of the first authorities, for as long as they have a record. Anyone may publish
        under any name, and Prometheus keeps a series for each."""
        self._authorities &= {record["name"] for record in records}
        labels = set[str]()
        for record in records:
            label = cut(printable(record["name"]), _MAX_LABEL_CHARS)
            if len(self._authorities) < self._max_authorities:
                self._authorities.add(record["name"])
            if record["name"] not in self._authorities or label in labels:
                continue
            labels.add(label)
            for field, metric in FROM_AUTHORITIES.items():
                if isinstance(record.get(field), (int, float)):
                    yield metric, (label,), float(record[field])


def _from_stats(stats: Mapping[str, Any]) -> Iterator[Value]:
    for key, metric in FROM_STATS.items():
        if isinstance(stats.get(key), (int, float)):
            yield metric, (), float(stats[key])
    for reason in admission.ALL_REASONS:
        yield metric_table.REFUSED, (reason,), float(stats.get(f"refused/{reason}", 0))
    for key, value in stats.items():
        field, _, robot = key.partition("/")
        if robot and field in FROM_ROBOTS:
            yield FROM_ROBOTS[field], (printable(robot),), float(value)


def _from_requests(server: RunningServer) -> Iterator[Value]:
    total = server.service.requests.total()
    for request_type, counts in sorted(total.ok.items()):
        yield metric_table.DURATION, (request_type, OK), counts
        yield metric_table.REQUESTS, (request_type, OK), float(sum(counts[:-1]))
    for request_type, counts in sorted(total.failed.items()):
        yield metric_table.DURATION, (request_type, "error"), counts
    for (request_type, error), count in sorted(total.failures.items()):
        yield metric_table.REQUESTS, (request_type, error), float(count)
