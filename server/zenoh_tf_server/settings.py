"""What a server is started with, from its flags and its configuration file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from .federation.settings import FederationSettings
from .ingest.future_stamps import FutureStamps
from .limits import Limits
from .motion_limits import MotionLimits
from .process.sharing import SharingSettings
from .ros2.settings import Ros2Settings
from .security.settings import OPEN, Security
from .state.state import StateSettings

Concurrency = Literal["optimistic", "2pl", "giant"]
TimeJump = Literal["reject", "clear"]


@dataclass(frozen=True)
class ServerSettings:
    tree: str
    listen: Sequence[str]  # endpoints of the embedded router; unused if `connect` is not empty
    connect: Sequence[str]  # endpoints of an existing network to join
    cache_time_s: float
    concurrency: Concurrency
    one_authority_per_frame: bool
    time_jump: TimeJump
    workers: int
    limits: Limits
    future: FutureStamps = field(default_factory=FutureStamps)
    security: Security = OPEN
    metrics: tuple[str, int] | None = None  # host and port where they are served
    state: StateSettings = field(default_factory=StateSettings)
    sharing: SharingSettings = field(default_factory=SharingSettings)
    ros2: Ros2Settings = field(default_factory=Ros2Settings)
    federation: FederationSettings = field(default_factory=FederationSettings)
    motion_limits: MotionLimits = field(default_factory=dict)
    replica_of: Sequence[str] = ()  # endpoints of the primary's network
