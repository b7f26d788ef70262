"""What a server is started with, from its flags and its configuration file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

from zenoh_tf.text.flag_values import host_and_port, whole
from zenoh_tf.text.time_flags import duration

from .federation.settings import FederationSettings
from .flag_table import flag
from .ingest import foreign
from .ingest.foreign import ForeignKey
from .ingest.future_stamps import FutureStamps
from .limits import Limits
from .monitoring.logs import GROUP, LogSettings
from .motion_limits import MotionLimits
from .process.sharing import SharingSettings
from .ros2.settings import Ros2Settings
from .security.settings import OPEN, Security
from .state.state import StateSettings

Concurrency = Literal["optimistic", "2pl", "giant"]
TimeJump = Literal["reject", "clear"]

DEFAULT_LISTEN: Final = "tcp/127.0.0.1:7447"
#: More threads only wait for each other.
_MAX_WORKERS: Final = 256


@dataclass(frozen=True)
class ServerSettings:
    """Everything that a server is started with."""

    listen: Sequence[str] = flag(  # unused if `connect` is not empty
        "--listen",
        (),
        "be a Zenoh router that listens on PROTOCOL/HOST:PORT; repeatable "
        f"(default: {DEFAULT_LISTEN})",
        group="network",
        action="append",
        metavar="ENDPOINT",
    )
    connect: Sequence[str] = flag(
        "--connect",
        (),
        "join the Zenoh network here as a client, and do not listen; repeatable",
        group="network",
        action="append",
        metavar="ENDPOINT",
    )
    replica_of: Sequence[str] = flag(
        "--replica-of",
        (),
        "be a read-only replica: serve a copy of the tree whose server is here; repeatable "
        "for further endpoints of it (docs/how-to/replicas.md)",
        group="network",
        action="append",
        metavar="ENDPOINT",
    )
    workers: int = flag(
        "--workers",
        min(8, max(2, os.cpu_count() or 2)),
        f"threads per type of request (2 to 8; at most {_MAX_WORKERS})",
        group="network",
        type=whole(1, _MAX_WORKERS),
        metavar="N",
    )
    tree: str = flag(
        "--tree", "main", "name of the tree (default: %(default)s)", group="tree", metavar="NAME"
    )
    cache_time_s: float = flag(
        "--cache-time",
        10.0,
        "history of each frame, back from its newest transform (default: %(default)gs)",
        group="tree",
        type=duration(above=True),
        metavar="DURATION",
    )
    concurrency: Concurrency = flag(
        "--concurrency",
        "optimistic",
        "optimistic; 2pl: long atomic reads; giant: as tf2",
        group="tree",
        choices=("optimistic", "2pl", "giant"),
        metavar="HOW",
    )
    one_authority_per_frame: bool = flag(
        "--one-authority-per-frame",
        False,
        "refuse a second authority's transforms of a frame, not only count them",
        group="tree",
    )
    time_jump: TimeJump = flag(
        "--time-jump",
        "reject",
        "with a transform older than the cache time: reject it as late, or, at the second "
        "one, clear the frame's history and store it (default: %(default)s)",
        group="tree",
        choices=("reject", "clear"),
        metavar="WHAT",
    )
    ingest: tuple[ForeignKey, ...] = flag(
        "--ingest",
        (),
        "store what others put on these keys: lcm (dimos), foxglove, foxglove-json or "
        "foxglove-flatbuffer; repeatable (docs/how-to/ingest.md)",
        group="tree",
        action="append",
        type=foreign.parse,
        metavar="KEY=FORMAT",
    )
    future: FutureStamps = field(default_factory=FutureStamps)
    limits: Limits = field(default_factory=Limits)
    state: StateSettings = field(default_factory=StateSettings)
    sharing: SharingSettings = field(default_factory=SharingSettings)
    security: Security = OPEN
    ros2: Ros2Settings = field(default_factory=Ros2Settings)
    federation: FederationSettings = field(default_factory=FederationSettings)
    logs: LogSettings = field(default_factory=LogSettings)
    metrics: tuple[str, int] | None = flag(  # host and port
        "--metrics",
        None,
        "serve /metrics, /healthz and /readyz here, as in 127.0.0.1:9464; needs "
        "zenoh-tf[metrics] (default: off)",
        group=GROUP,
        type=host_and_port,
        metavar="HOST:PORT",
    )
    motion_limits: MotionLimits = field(default_factory=dict)  # from the configuration file
