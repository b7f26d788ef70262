"""The part of the native module `_core` that reads trees of other processes."""

import enum
from collections.abc import Sequence
from typing import Literal, final

from zenoh_tf._core import Tree
from zenoh_tf._core_stubs.reads import Reads
from zenoh_tf._core_stubs.transform import LatestTransform, StampedTransform

LAYOUT: tuple[int, int]  # version and hash of the layout that this build writes and reads

class RegionRefused(ValueError): ...

class LeaseKeeper:
    # Holds a shared tree's lease from a thread of its own, which Python cannot delay. Only for an
    # owner whose tree no other process can take over while this one lives, however long it stops.
    def __init__(self, tree: Tree) -> None: ...
    def end(self) -> None: ...

@final
class AskServer(enum.Enum):
    def __bool__(self) -> Literal[False]: ...  # zenoh_tf.shared_tree

    BUSY = ...
    LAPSED = ...
    WAITING = ...
    UNREADABLE = ...
    ABSENT = ...

class SharedTree(Reads[AskServer]):
    # A tree of another process; see zenoh_tf.shared_tree.
    def __init__(self, fd: int) -> None: ...  # does not keep it; RegionRefused says why not
    @property
    def instance(self) -> str: ...
    @property
    def lease_left_s(self) -> float: ...

    # As Tree's, or AskServer.
    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform | AskServer: ...
    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform | AskServer: ...
    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool | AskServer: ...
    def lookup_latest_transform(self, target: str, source: str) -> LatestTransform | AskServer: ...
    def lookup_latest_transform_xact(
        self, target: str, source: str
    ) -> LatestTransform | AskServer: ...
    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform] | AskServer: ...
    def latest_common_time(self, a: str, b: str) -> int | AskServer | None: ...
    def frames(self) -> list[str] | AskServer: ...
    def parent(self, frame: str, stamp_ns: int | None = None) -> str | AskServer | None: ...
    def chain(
        self, target: str, source: str, stamp_ns: int | None = None
    ) -> list[str] | AskServer: ...
