"""Every metric of the server in one table. The collector and docs/reference/metrics.md are made
from it.

``python -m zenoh_tf_server.monitoring.metric_table > docs/reference/metrics.md`` writes the page.

To export a new value, put it into `stats` (`Service.add_counters`) and declare its key in
`FROM_STATS`. Keys that differ in a label only, such as one queue per request type, share a metric:
declare each key with its label's value. A new field of an authority's record is declared in
`FROM_AUTHORITIES`, and one of a robot in `FROM_ROBOTS`. A test finds what is not declared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

PREFIX: Final = "zenoh_tf_"

Kind = Literal["counter", "gauge", "histogram"]


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric, by Prometheus' rules: base units, counters end in ``_total``."""

    name: str  # without PREFIX
    kind: Kind
    meaning: str
    labels: tuple[str, ...] = ()
    values: tuple[str, ...] = ()  # of the labels, if they are fixed
    scale: float = 1.0  # the exported value is the source's, times this

    @property
    def full_name(self) -> str:
        return PREFIX + self.name


def _gauge(name: str, meaning: str, scale: float = 1.0, **labels: str) -> Metric:
    return Metric(name, "gauge", meaning, tuple(labels), tuple(labels.values()), scale)


def _counter(name: str, meaning: str, scale: float = 1.0, **labels: str) -> Metric:
    return Metric(f"{name}_total", "counter", meaning, tuple(labels), tuple(labels.values()), scale)


#: Key of `stats` -> metric.
FROM_STATS: Final[dict[str, Metric]] = {
    "frames": _gauge("frames", "frames in the tree"),
    "static_links": _gauge("static_links", "static links in the tree"),
    "samples": _gauge("samples", "samples of all dynamic links"),
    "memory_bytes": _gauge("tree_memory_bytes", "bytes that the tree's frames and samples take"),
    "waiters": _gauge("waiting_lookups", "lookups that wait for a transform"),
    "pending_queries": _gauge("queued_queries", "queries that wait for a worker"),
    "pending_bytes": _gauge("queued_query_bytes", "bytes of the queries that wait for a worker"),
    "local_connections": _gauge(
        "local_connections", "connections of clients on this host, who send requests through them"
    ),
    "unread_reply_bytes": _gauge(
        "unread_reply_bytes", "bytes of replies that wait for clients that do not read"
    ),
    "outcomes": _gauge("remembered_outcomes", "replies to writes, remembered until their expiry"),
    "state_pending": _gauge(
        "state_pending", "changes of links that are not stored yet (`--state-dir`)"
    ),
    "clients_cut_off": _counter(
        "clients_cut_off", "connections closed because the client did not read its replies"
    ),
    "commits": _counter("commits", "transactions that were committed, puts included"),
    "rewritten": _counter("samples_rewritten", "samples at a stamp that the link already had"),
    "dropped": _counter("samples_dropped", "samples older than the cache time of their link"),
    "from_future": _counter(
        "samples_from_future", "samples refused because their stamp is too far ahead of the clock"
    ),
    "evicted": _counter("samples_evicted", "samples removed because a link's history was full"),
    "time_jumps": _counter("time_jumps", "times that the clock was seen to be set back"),
    "flagged_as_future": _counter(
        "flagged_as_future", "published transforms stored although they are from the future"
    ),
    "dropped_by_queue": _counter(
        "puts_dropped", "published messages dropped because too many of an authority were waiting"
    ),
    "dropped_as_stale": _counter(
        "puts_dropped_as_stale",
        "published messages dropped because they had waited for too long (`put_wait_ms`)",
    ),
    "replica_age_s": _gauge(
        "replica_age_seconds", "of a replica: how old the state that it serves may be"
    ),
    "replica_seq": _gauge(
        "replica_seq", "of a replica: the last commit of the primary that it has"
    ),
    "replica_snapshots": _counter(
        "replica_snapshots", "of a replica: copies of the primary's tree that were begun"
    ),
    "replica_contradictions": _counter(
        "replica_contradictions",
        "of a replica: copies given up because the primary says otherwise: somebody forges its "
        "messages",
    ),
    "stream_messages": _counter("stream_messages", "messages published for mirrors"),
    "stream_message_bytes": _counter(
        "stream_message_bytes", "bytes of the messages published for mirrors"
    ),
    "stream_gaps": _counter(
        "stream_gaps", "times that changes were left out of the stream, as too many were waiting"
    ),
    "stream_kept_bytes": _gauge(
        "stream_kept_bytes", "bytes of published messages, kept for mirrors that missed some"
    ),
    "interests": _gauge("interests", "interests of mirrors that do not want all frames"),
    "interest_frames": _gauge(
        "interest_frames", "frames in interests of mirrors, summed over all interests"
    ),
    "interest_messages": _counter(
        "interest_messages", "messages published for mirrors that do not want all frames"
    ),
    "interest_message_bytes": _counter(
        "interest_message_bytes", "bytes of the messages for mirrors that do not want all frames"
    ),
    "change_log_bytes": _gauge("change_log_bytes", "bytes of changes that wait to be published"),
    "ros2_messages": _counter("ros2_messages", "messages of ROS 2 that were received (`--ros2`)"),
    "ros2_bad_keys": _counter("ros2_bad_keys", "messages dropped as their key is not of ROS 2"),
    "ros2_bad_attachments": _counter(
        "ros2_bad_attachments", "messages of ROS 2 whose attachment was not understood"
    ),
    "ros2_publishers": _gauge("ros2_publishers", "publishers of transforms on ROS 2"),
    "ros2_static_links": _gauge(
        "ros2_static_links", "static transforms of ROS 2, counted for each publisher"
    ),
    "ros2_statics_dropped": _counter(
        "ros2_statics_dropped", "static links removed because their publisher was gone"
    ),
    "ros2_unanswered": _counter(
        "ros2_unanswered", "times that a publisher did not send its static transforms in time"
    ),
    "ros2_silent": _gauge(
        "ros2_silent",
        "publishers that declare to keep static transforms, and sent none when asked",
    ),
    "ros2_unpublishable": _counter(
        "ros2_unpublishable", "transforms left out because ROS 2 has no such stamp or name"
    ),
    "ros2_published_messages": _counter(
        "ros2_published_messages", "messages published on ROS 2 (`--ros2-publish`)"
    ),
    "ros2_published_transforms": _counter(
        "ros2_published_transforms", "transforms in messages published on ROS 2 (`--ros2-publish`)"
    ),
    "puts": _counter("puts", "published messages that were committed"),
    "put_transforms": _counter("put_transforms", "transforms stored from published messages"),
    "bad_puts": _counter("puts_refused", "published messages that were refused"),
    "dropped_as_too_old": _counter(
        "put_transforms_too_old", "published transforms dropped as older than the cache time"
    ),
}

#: Keys of `stats` that are no metrics.
NOT_EXPORTED: Final[frozenset[str]] = frozenset()


def _per_authority(name: str, kind: Kind, meaning: str, scale: float = 1.0) -> Metric:
    return Metric(f"authority_{name}", kind, meaning, ("authority",), scale=scale)


#: Field of an authority's record -> metric.
FROM_AUTHORITIES: Final[dict[str, Metric]] = {
    "frames": _per_authority("frames", "gauge", "frames whose newest sample is the authority's"),
    "commits": _per_authority("commits_total", "counter", "transactions of the authority"),
    "stored": _per_authority("transforms_stored_total", "counter", "transforms stored"),
    "dropped": _per_authority("transforms_dropped_total", "counter", "transforms dropped as late"),
    "rewritten": _per_authority(
        "transforms_rewritten_total", "counter", "transforms at a stamp that was already there"
    ),
    "conflicts": _per_authority(
        "conflicts_total", "counter", "frames taken over from another authority"
    ),
    "refused": _per_authority("transforms_refused_total", "counter", "transforms refused"),
    "dropped_by_queue": _per_authority(
        "puts_dropped_total", "counter", "messages dropped because too many were waiting"
    ),
    "clock_offset_min_s": _per_authority(
        "clock_offset_min_seconds", "gauge", "least lead of its stamps over their arrival"
    ),
    "clock_offset_max_s": _per_authority(
        "clock_offset_max_seconds", "gauge", "greatest lead of its stamps over their arrival"
    ),
    "stamp_age_s": _per_authority(
        "stamp_age_seconds", "gauge", "age of the newest stamp of its last message on arrival"
    ),
}


def _per_robot(name: str, kind: Kind, meaning: str) -> Metric:
    return Metric(f"robot_{name}", kind, f"of a robot (`--mirror-of`): {meaning}", ("robot",))


#: Key of `stats`, without "/" and the robot -> metric.
FROM_ROBOTS: Final[dict[str, Metric]] = {
    "robot_connected": _per_robot("connected", "gauge", "1 if its server is heard, else 0"),
    "robot_age_s": _per_robot(
        "age_seconds", "gauge", "how old what is known of its tree may be; 1e9 before it is known"
    ),
    "robot_snapshots": _per_robot("snapshots_total", "counter", "copies of its tree begun"),
    "robot_received": _per_robot(
        "transforms_received_total", "counter", "transforms received, some of them twice"
    ),
    "robot_left_out": _per_robot(
        "transforms_left_out_total", "counter", "transforms of shared frames, which are not stored"
    ),
    "robot_over_quota": _per_robot(
        "transforms_over_quota_total", "counter", "transforms of frames above its share of frames"
    ),
    "robot_frames": _per_robot("frames", "gauge", "frames that count towards its share"),
    "robot_max_frames": _per_robot("frames_limit", "gauge", "its share of frames"),
    "robot_removals": _per_robot(
        "removals_total", "counter", "frames that it has cleared or removed, and that stay here"
    ),
    "robot_stored": _per_robot("transforms_stored_total", "counter", "transforms stored"),
    "robot_dropped": _per_robot("transforms_dropped_total", "counter", "transforms too old"),
    "robot_refused": _per_robot("transforms_refused_total", "counter", "transforms refused"),
    "robot_dropped_by_queue": _per_robot(
        "puts_dropped_total", "counter", "messages dropped because too many were waiting"
    ),
}

#: Fields of an authority's record without a meaningful sum over several authorities.
NOT_SUMMED: Final = frozenset({"clock_offset_min_s", "clock_offset_max_s", "stamp_age_s"})

#: Fields of an authority's record that are no metrics.
AUTHORITY_NOT_EXPORTED: Final[frozenset[str]] = frozenset({"name", "last_refusal"})

REQUESTS: Final = Metric(
    "requests_total",
    "counter",
    'requests served; `outcome` is "ok" or the class of the error in the reply',
    ("request_type", "outcome"),
)
DURATION: Final = Metric(
    "request_duration_seconds",
    "histogram",
    "from the moment a worker starts a request until it has replied, or has parked a lookup that "
    'waits; `outcome` is "ok" or "error"',
    ("request_type", "outcome"),
)
LIMIT: Final = Metric("limit", "gauge", "a limit of docs/reference/limits.md, by name", ("limit",))
CLIENTS: Final = _gauge("connected_clients", "clients that are connected")
CLIENT_AHEAD: Final = _gauge(
    "client_clock_ahead_seconds",
    "least lead over the server's of the client clock that is most ahead; 0 if none is",
)
CLIENT_BEHIND: Final = _gauge(
    "client_clock_behind_seconds",
    "least lag behind the server's of the client clock that is most behind; 0 if none is",
)
THREADS: Final = _gauge("threads", "threads of Python in the server's process")
READY: Final = _gauge("ready", "1 if the tree is claimed and served, else 0")
HEALTHY: Final = _gauge("healthy", "1 if a worker has answered the latest probes, else 0")
PROBE: Final = _gauge("probe_duration_seconds", "how long the latest probe lookup took")
BUILD: Final = Metric(
    "build_info",
    "gauge",
    "always 1; the labels say what runs",
    ("version", "python", "zenoh", "tree", "server_instance"),
)
OTHERS: Final = (
    *(REQUESTS, DURATION, LIMIT, CLIENTS, CLIENT_AHEAD, CLIENT_BEHIND, THREADS),
    *(READY, HEALTHY, PROBE, BUILD),
)


def all_metrics() -> Iterator[Metric]:
    """Every metric of the server once, by name."""
    metrics = {
        metric.name: metric
        for metric in (
            *(*FROM_STATS.values(), *FROM_AUTHORITIES.values()),
            *(*FROM_ROBOTS.values(), *OTHERS),
        )
    }
    yield from (metrics[name] for name in sorted(metrics))


def page() -> Iterator[str]:
    """The lines of docs/reference/metrics.md."""
    yield "# Metrics"
    yield ""
    yield "`zenoh-tf-server --metrics 127.0.0.1:9464` serves metrics for Prometheus at `/metrics`,"
    yield "and `/healthz` and `/readyz` beside it (see [Deployment](../how-to/deploy.md)). It needs"
    yield "the extra: `pip install '.[metrics]'` in a checkout. Without the flag, nothing listens."
    yield "The port has neither encryption nor passwords: let it listen where only Prometheus"
    yield "reaches it."
    yield ""
    yield "| metric | kind | labels | of what |"
    yield "|---|---|---|---|"
    for metric in all_metrics():
        labels = ", ".join(f"`{label}`" for label in metric.labels)
        yield f"| `{metric.full_name}` | {metric.kind} | {labels} | {metric.meaning} |"
    yield ""
    yield "Beside these there are the process's own: `process_resident_memory_bytes`,"
    yield "`process_virtual_memory_bytes`, `process_cpu_seconds_total`, `process_open_fds`,"
    yield "`process_max_fds` and `process_start_time_seconds`."
    yield ""
    yield "- The label `authority` is bounded: the first `--limit metrics_authorities` authorities"
    yield '  that are seen have series of their own, all others share `authority="(other)"`. Names'
    yield "  are escaped and cut to 100 characters."
    yield "- The tree is read at most once a second, however often the port is asked."
    yield "- The probe of `/healthz` is a lookup every few seconds, and counts among the requests."
    yield "- Counters start at zero when the server starts, and some when the tree is reset."


if __name__ == "__main__":
    print("\n".join(page()))
