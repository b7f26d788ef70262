"""The native module `_core`: the tree, and what the server needs of it.

This stub and `_core_stubs/transform.pyi` are the one source of signatures and docstrings: help() shows them,
too (bindings/stub_docs.py). `X_target_source` is the pose of source in target, in metres.
"""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Never

from zenoh_tf._core_stubs.change_log import ChangeLog as ChangeLog
from zenoh_tf._core_stubs.change_log import ChangeReplay as ChangeReplay
from zenoh_tf._core_stubs.change_log import Changes as Changes
from zenoh_tf._core_stubs.change_log import Frames as Frames
from zenoh_tf._core_stubs.change_log import InterestReader as InterestReader
from zenoh_tf._core_stubs.change_log import wait_for_changes as wait_for_changes
from zenoh_tf._core_stubs.columns import TransformRows as TransformRows
from zenoh_tf._core_stubs.columns import columns_of_pairs as columns_of_pairs
from zenoh_tf._core_stubs.columns import decode_puts as decode_puts
from zenoh_tf._core_stubs.columns import decode_tf_message as decode_tf_message
from zenoh_tf._core_stubs.columns import decode_tf_messages as decode_tf_messages
from zenoh_tf._core_stubs.estimates import Estimate as Estimate
from zenoh_tf._core_stubs.points import deskew_by_samples as deskew_by_samples
from zenoh_tf._core_stubs.points import map_rows as map_rows
from zenoh_tf._core_stubs.reads import Reads as _Reads
from zenoh_tf._core_stubs.shared import LAYOUT as LAYOUT
from zenoh_tf._core_stubs.shared import AskServer as AskServer
from zenoh_tf._core_stubs.shared import LeaseKeeper as LeaseKeeper
from zenoh_tf._core_stubs.shared import RegionRefused as RegionRefused
from zenoh_tf._core_stubs.shared import SharedTree as SharedTree
from zenoh_tf._core_stubs.shared import ask_absent as ask_absent
from zenoh_tf._core_stubs.transform import LatestTransform as LatestTransform
from zenoh_tf._core_stubs.transform import Rows as Rows
from zenoh_tf._core_stubs.transform import StampedTransform as StampedTransform
from zenoh_tf._core_stubs.transform import Transform as Transform
from zenoh_tf._core_stubs.waiting import ParkedLookups as ParkedLookups
from zenoh_tf._core_stubs.waiting import WakeQueue as WakeQueue
from zenoh_tf._core_stubs.waiting import park_lookups as park_lookups

OP_AT: int  # what a row of `Tree._read_rows` asks for: source in target at stamp_ns
OP_COMMON: int  # the same at the latest common time
OP_LATEST: int  # newest of every link, links may be of different commits
OP_LATEST_XACT: int  # the same, atomically
OP_COMMON_TIME: int  # only the latest common time, in the answer's stamp
OP_FULL: int  # source at source_stamp_ns in target at stamp_ns, through fixed; NO_STAMP: latest
NO_STAMP: int  # INT64_MIN, "no time given"; an ordinary row may not carry it

def join_buffers(parts: Sequence[bytes | memoryview]) -> bytes: ...  # copies without the GIL
def decoded_size(message: bytes) -> int: ...  # in bytes; -1: malformed, -2: nested too deeply

# A length of time in short form: "850 us", "12 ms", "3.4 s", "5 min", "8.0 h", "6.5 days",
# "56.9 years".
def age(length_ns: float) -> str: ...

# The unit of a stamp that should be in nanoseconds; None if it may be in nanoseconds. The others
# are the oldest and the newest of the stamps beside it. Read in its unit, the stamp may lie outside
# of both by a day, in simulated time by a minute.
def other_unit(stamp_ns: int, oldest_ns: int, newest_ns: int) -> str | None: ...

# As of zenoh_tf.text.similar; did_you_mean returns "" for None.
def similar_names(name: str, names: Sequence[str], most: int = 3) -> list[str]: ...
def did_you_mean(unknown: Sequence[str], names: Sequence[str]) -> str: ...

# A lookup of one row. None: the message is not of the plain form, or the lookup fails.
def pack_single_lookup(target: str, source: str, op: int, stamp_ns: int) -> bytes | None: ...
def reply_to_lookup(tree: Tree, message: bytes, instance: str) -> bytes | None: ...
def parse_single_answer(  # (stamp, newest stamp, pose), of a reply of this server instance
    reply: bytes, instance: str
) -> tuple[int, int, Transform] | None: ...

class Budget:
    """What one message to the server may still cost. To take more than is left raises
    `LimitExceeded`, which names the limit."""

    def __init__(self, **limits: int) -> None: ...  # see `Limits.budget` of the server
    def take_links(self, n: int) -> None: ...
    def take_listed(self, n: int) -> None: ...
    def take_reply(self, n: int) -> None: ...
    @property
    def listed_left(self) -> int: ...

class Tree(_Reads[Never]):
    """The native tree; see `zenoh_tf.TransformTree`."""

    def __init__(
        self,
        cache_time_s: float = 10.0,
        concurrency: Literal["optimistic", "2pl", "giant"] = "optimistic",
        *,
        max_frames: int = 1 << 20,
        max_samples_per_frame: int = 1 << 16,
        max_name_bytes: int = 255,
        max_depth: int = 1000,
        one_authority_per_frame: bool = False,
        time_jump: Literal["reject", "clear"] = "reject",
        max_memory_bytes: int = 0,
        max_log_bytes: int = 0,
        _shared: bool = False,  # other processes may map it; OSError if the host cannot
        _instance: str = "",  # which server this is, for these processes
    ) -> None: ...
    def _region_fd(self) -> int: ...  # belongs to the tree; -1 if it is not shared
    def _begin_lease(self, duration_s: float) -> None: ...  # see zenoh_tf.shared_tree
    # A server with this tree started `elapsed_ns` ago, and for `left_ns` more its publishers may
    # not be back: an unknown frame is ServerStarting.
    def _begin_startup(self, elapsed_ns: int, left_ns: int) -> None: ...
    _is_recorded: bool  # it has no present and no publishers
    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> bool:
        """Store the pose of a child frame in its parent, creating frames that do not exist.

        At an equal stamp the last write wins. A write under another parent reparents the child
        from its stamp on.

        Args:
            stamped: `X_parent_child` in metres, at its stamp in nanoseconds.
            authority: Name of the publisher, for introspection.
            static: The link holds at all times.

        Returns:
            True if stored, False if dropped: older than the link's newest by more than the cache
            time.

        Raises:
            InvalidArgumentException: A name, number or rotation is invalid, the link would close
                a cycle, or another authority publishes it (`one_authority_per_frame`).
            LimitExceeded: A limit of the tree is reached; `field` names it.
        """
    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None:
        """Store several transforms at one instant: all of them or none.

        Args:
            stampeds: `X_parent_child` in metres each, at their stamps in nanoseconds.
            authority: Name of the publisher, for introspection.
            static: The links hold at all times.

        Raises:
            InvalidArgumentException: One of them is invalid, too old for its link's cache, or
                would close a cycle.
            LimitExceeded: A limit of the tree is reached; `field` names it.
        """
    def clear(self, keep_static: bool = True) -> None:
        """Drop all samples at one instant. Frames keep their names.

        Args:
            keep_static: Static links stay.
        """
    def reset(self) -> None:
        """Drop every frame at one instant: all samples, static links and names.

        The tree is then as new, apart from its authorities and the counters of `stats`. To keep
        the names, use `clear(False)`.
        """
    def remove_frame(self, name: str, subtree: bool = False) -> None:
        """Remove a frame at one instant: its link, its history and its name.

        Args:
            name: The frame.
            subtree: Also remove all frames below it.

        Raises:
            LookupException: The frame does not exist.
            InvalidArgumentException: The name is invalid, or the frame is the parent of another
                and `subtree` is False.
        """
    def stats(self) -> dict[str, int]:
        """Return counters of the whole tree, by name.

        `frames`, `static_links`, `samples`, `memory_bytes` (of all samples, with the memory
        that waits to be used again) and `waiters` (lookups that wait now) count what there is;
        `commits`, `rewritten`, `dropped`, `evicted` (samples), `from_future` (dropped rows later
        than the server accepts) and `time_jumps` what was.
        """
    def __repr__(self) -> str: ...  # what follows is internal to zenoh_tf and the server
    def _commit_rows(
        self,
        rows: TransformRows,
        *,
        authority: str = "",
        static: bool = False,
        drop_old: bool = False,  # True: too old rows are dropped; False: they refuse the whole
        drop_bad: bool = False,  # True: bad rows are refused; False: they refuse the whole
        drop_strays: bool = False,  # with drop_bad: refuse what is far ahead, unless it continues
        read_names: Sequence[str] = (),
        read_versions: NDArray[np.uint64] | None = None,  # moved: TransactionConflict
        # time.monotonic_ns(), read under the locks: later, TimeoutException and nothing is written
        expires_ns: int | None = None,
        # A later dynamic row: InvalidArgumentException, field "stamp"; with drop_old it is dropped.
        max_stamp_ns: int | None = None,
    ) -> bytes: ...  # of each row what became of it: zenoh_tf/admission.py has the numbers
    # Dynamic puts, each a transaction of its own, as `_commit_rows` with drop_old and drop_bad, in
    # their order and without the interpreter lock. Of each: None, all rows are stored; what
    # `_commit_rows` returns; or the error that refused it.
    def _commit_puts(
        self,
        rows: list[TransformRows],
        authorities: list[str],
        max_stamps_ns: Sequence[int | None],
        drop_strays: Sequence[bool] | None = None,  # None: all
    ) -> list[bytes | Exception | None]: ...
    # Why `_commit_rows` or `_commit_puts` refused rows: an error for each frame and reason, of the
    # first so many.
    def _refusals(self, rows: TransformRows, stored: bytes) -> list[Any]: ...  # exceptions
    def _clear(self, keep_static: bool, expires_ns: int) -> None: ...  # expires as _commit_rows
    def _reset(self, expires_ns: int) -> None: ...
    def _remove_frame(self, name: str, subtree: bool, expires_ns: int) -> None: ...
    def _frames_page(
        self, after: int, most: int, whole: bool, budget: Budget
    ) -> tuple[list[str], Any]: ...
    def _frame_count(self) -> int: ...  # also removed ones: what a scan of all frames costs
    def _links(self, frames: Sequence[str]) -> int: ...  # from the frames up to their roots
    def _take_events(self) -> tuple[list[dict[str, Any]], int]: ...
    def _authority_records(self) -> list[dict[str, Any]]: ...  # AuthorityInfo's fields
    def _motion_limits(self) -> dict[str, tuple[float, float, float, float, float]]: ...
