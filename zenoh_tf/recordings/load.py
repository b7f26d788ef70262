"""Commits a recording to a tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from .. import admission
from .._core import TransformRows
from ..errors import LimitExceeded
from ..text.times import seconds
from ..wire import commit_parts
from .errors import RecordingError
from .recording import Recording

if TYPE_CHECKING:
    from ..tree import TransformTree

#: Most bytes of all samples of a tree from a recording, unless the caller says otherwise.
MAX_MEMORY_BYTES: Final = 4 << 30
#: Options of a tree that keeps a recording as a whole: the most that the core allows.
OPTIONS: Final[dict[str, Any]] = {"cache_time_s": 1e9, "max_samples_per_frame": 1 << 30}

#: Stamps further from the times of the log are of another clock, such as a simulation's.
_OTHER_CLOCK_NS: Final = 60 * 10**9

#: Limits that no other row would keep either, as reasons and as fields of errors.
_FULL: Final = ("memory_limit", "frame_limit", "max_memory", "max_frames")


def load(
    recording: Recording,
    tree: TransformTree,
    on_messages: Callable[[int], None] | None = None,
    until_ns: int | None = None,
) -> None:
    """Commit all messages of a recording; what no tree accepts is left out and counted.

    Args:
        recording: Where they come from. Its counters say what was left out.
        tree: Where they go. It keeps all of them if it was made with `OPTIONS`.
        on_messages: Called with the number of messages committed, now and then.
        until_ns: Leave out what was recorded later, in nanoseconds, so that the tree knows what a
            live one knew at that time, which is "now" for its estimates; None for nothing.

    Raises:
        RecordingError: The recording is damaged, or has no transforms by then, or its log has
            another clock than its stamps.
        LimitExceeded: The tree's memory is full, or it has too many frames.
    """
    done = 0
    tree._is_recorded = True
    for block in recording.blocks(until_ns):
        for _ in valid_commits(recording, tree, block.rows, block.static):
            pass
        done += block.messages
        if on_messages is not None:
            on_messages(done)
    if until_ns is not None:
        _check_clock(recording)
        tree._now_ns = lambda: until_ns


def _check_clock(recording: Recording) -> None:
    """Raise RecordingError if the times of the log say nothing about the stamps."""
    log_ns = recording.last_log_ns
    if log_ns is None or recording.range_ns is None:
        return
    first_ns, last_ns = recording.range_ns
    if not first_ns - _OTHER_CLOCK_NS <= log_ns <= last_ns + _OTHER_CLOCK_NS:
        raise RecordingError(
            f"what was known by then is unclear: the log is at {seconds(log_ns)} s and the "
            f"stamps at {seconds(last_ns)} s, as with simulated time"
        )


def valid_commits(
    recording: Recording, tree: TransformTree, rows: TransformRows, static: bool
) -> Iterator[TransformRows]:
    """Commit rows in as many commits as it needs, without the rows that the tree refuses, which
    the recording counts. Yields the rows of each commit."""
    for commit in commit_parts(rows):
        stored = tree._commit_rows(commit, static=static, drop_old=True, drop_bad=True)
        if admission.refused(tree, commit, stored) is not None:
            commit = _without_refused(recording, tree, commit, stored)  # noqa: PLW2901
        if not len(commit):
            continue
        if not static:
            first_ns, last_ns = int(commit.stamp.min()), int(commit.stamp.max())
            known = recording.range_ns or (first_ns, last_ns)
            recording.range_ns = min(known[0], first_ns), max(known[1], last_ns)
        yield commit


def _without_refused(
    recording: Recording, tree: TransformTree, rows: TransformRows, stored: bytes
) -> TransformRows:
    """Return the rows that the tree has not refused, and count the others.

    Raises:
        LimitExceeded: The tree is full.
    """
    results = np.frombuffer(stored, np.uint8)
    refused = np.flatnonzero(results > admission.FROM_FUTURE)
    for row in map(int, refused):
        if not recording.skipped or admission.REASONS[stored[row]] in _FULL:
            error = tree._refusals(rows[row : row + 1], stored[row : row + 1])[0]
            if isinstance(error, LimitExceeded) and error.field in _FULL:
                raise error
            recording.first_skipped = str(error)
        recording.skipped += 1
    return rows[np.flatnonzero(results <= admission.FROM_FUTURE)]
