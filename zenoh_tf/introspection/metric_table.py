"""Every counter of `stats` and every metric of the server in one table, for the server's collector
and the command line.

``python -m zenoh_tf.introspection.metric_table`` prints the table of docs/reference/metrics.md.

To export a new value, put it into `stats` (`Service.add_counters`) and declare it in `_STATS`. A
new field of an authority's record is declared in `FROM_AUTHORITIES`, and one of a robot in
`FROM_ROBOTS`. A test finds what is not declared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter
from typing import Final, Literal

from zenoh_tf import admission

PREFIX: Final = "zenoh_tf_"

Kind = Literal["counter", "gauge", "histogram"]


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric, by Prometheus' rules: base units, counters end in ``_total``."""

    name: str  # without PREFIX
    kind: Kind
    meaning: str
    labels: tuple[str, ...] = ()
    key: str = ""  # of its value in `stats`

    @property
    def full_name(self) -> str:
        return PREFIX + self.name


def _gauge(name: str, meaning: str, key: str = "") -> Metric:
    """`key`: of its value in `stats`, if that is not the name."""
    return Metric(name, "gauge", meaning, key=key or name)


def _counter(name: str, meaning: str, key: str = "") -> Metric:
    return Metric(f"{name}_total", "counter", meaning, key=key or name)


#: The values of `stats`.
_STATS: Final = (
    _gauge("frames", "frames in the tree"),
    _gauge("static_links", "static links in the tree"),
    _gauge("samples", "samples of all dynamic links"),
    _gauge(
        "tree_memory_bytes",
        "bytes of all samples, with the memory that waits for further ones",
        key="memory_bytes",
    ),
    _gauge("waiting_lookups", "lookups that wait for a transform", key="waiters"),
    _gauge("queued_queries", "queries that wait for a worker", key="pending_queries"),
    _gauge(
        "queued_query_bytes", "bytes of the queries that wait for a worker", key="pending_bytes"
    ),
    _gauge("unread_reply_bytes", "bytes of replies that wait for clients that do not read"),
    _gauge(
        "remembered_outcomes", "replies to writes, remembered until their expiry", key="outcomes"
    ),
    _gauge("state_pending", "changes of links that are not stored yet (`--state-dir`)"),
    _counter("clients_cut_off", "connections closed because the client did not read its replies"),
    _counter("commits", "transactions that were committed, puts included"),
    _counter("samples_rewritten", "samples at a stamp that the link already had", key="rewritten"),
    _counter("samples_dropped", "samples older than the cache time of their link", key="dropped"),
    _counter(
        "samples_from_future",
        "samples refused because their stamp is too far ahead of the clock",
        key="from_future",
    ),
    _counter("samples_evicted", "samples removed because a link's history was full", key="evicted"),
    _counter("time_jumps", "times that a link's clock was set back, or jumped ahead"),
    _counter("flagged_as_future", "published transforms stored although they are from the future"),
    _counter(
        "puts_dropped",
        "published messages dropped because too many of an authority were waiting",
        key="dropped_by_queue",
    ),
    _counter(
        "puts_dropped_as_stale",
        "published messages dropped because they had waited for too long (`put_wait_ms`)",
        key="dropped_as_stale",
    ),
    _gauge(
        "replica_age_seconds",
        "of a replica: how old the state that it serves may be",
        key="replica_age_s",
    ),
    _gauge("replica_seq", "of a replica: the last commit of the primary that it has"),
    _counter("replica_snapshots", "of a replica: copies of the primary's tree that were begun"),
    _counter(
        "replica_contradictions",
        "of a replica: copies given up because the primary says otherwise: somebody "
        "forges its messages",
    ),
    _counter("stream_messages", "messages published for mirrors"),
    _counter("stream_message_bytes", "bytes of the messages published for mirrors"),
    _counter(
        "stream_gaps", "times that changes were left out of the stream, as too many were waiting"
    ),
    _gauge("stream_kept_bytes", "bytes of published messages, kept for mirrors that missed some"),
    _gauge("interests", "interests of mirrors that do not want all frames"),
    _gauge("interest_frames", "frames in interests of mirrors, summed over all interests"),
    _counter("interest_messages", "messages published for mirrors that do not want all frames"),
    _counter(
        "interest_message_bytes", "bytes of the messages for mirrors that do not want all frames"
    ),
    _gauge("change_log_bytes", "bytes of changes that wait to be published"),
    _counter("ros2_messages", "messages of ROS 2 that were received (`--ros2`)"),
    _counter("ros2_bad_keys", "messages dropped as their key is not of ROS 2"),
    _counter("ros2_bad_attachments", "messages of ROS 2 whose attachment was not understood"),
    _gauge("ros2_publishers", "publishers of transforms on ROS 2"),
    _gauge("ros2_static_links", "static transforms of ROS 2, counted for each publisher"),
    _counter("ros2_statics_dropped", "static links removed because their publisher was gone"),
    _counter(
        "ros2_unanswered", "times that a publisher did not send its static transforms in time"
    ),
    _gauge(
        "ros2_silent", "publishers that declare to keep static transforms, and sent none when asked"
    ),
    _counter("ros2_unpublishable", "transforms left out because ROS 2 has no such stamp"),
    _counter("ros2_published_messages", "messages published on ROS 2 (`--ros2-publish`)"),
    _counter(
        "ros2_published_transforms", "transforms in messages published on ROS 2 (`--ros2-publish`)"
    ),
    _counter("puts", "published messages that were committed"),
    _counter("put_transforms", "transforms stored from published messages"),
    _counter("puts_refused", "published messages that were refused", key="bad_puts"),
    _counter(
        "put_transforms_too_old",
        "published transforms dropped as older than the cache time",
        key="dropped_as_too_old",
    ),
)
FROM_STATS: Final = {metric.key: metric for metric in _STATS}


def _per_authority(name: str, kind: Kind, meaning: str) -> Metric:
    return Metric(f"authority_{name}", kind, meaning, ("authority",))


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

#: Of `stats` "refused/" and the reason.
REFUSED: Final = Metric(
    "put_transforms_refused_total",
    "counter",
    "published transforms refused, by reason: "
    + ", ".join(f"`{reason}`" for reason in admission.ALL_REASONS),
    ("reason",),
)

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
    *(REFUSED, REQUESTS, DURATION, LIMIT, CLIENTS, CLIENT_AHEAD, CLIENT_BEHIND, THREADS),
    *(READY, HEALTHY, PROBE, BUILD),
)


def all_metrics() -> list[Metric]:
    """Every metric of the server, by name."""
    per_part = (*FROM_AUTHORITIES.values(), *FROM_ROBOTS.values())
    return sorted((*_STATS, *per_part, *OTHERS), key=attrgetter("name"))


def table() -> Iterator[str]:
    """The lines of the table in docs/reference/metrics.md."""
    yield "| metric | kind | labels | of what |"
    yield "|---|---|---|---|"
    for metric in all_metrics():
        labels = ", ".join(f"`{label}`" for label in metric.labels)
        yield f"| `{metric.full_name}` | {metric.kind} | {labels} | {metric.meaning} |"


if __name__ == "__main__":
    print("\n".join(table()))
