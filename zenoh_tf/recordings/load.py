"""Commits a recording to a tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final

from .._core import TransformRows
from ..errors import InvalidArgumentException, LimitExceeded
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

#: Limits that no other row would keep either.
_FULL: Final = ("max_memory", "max_frames")


def load(
    recording: Recording,
    tree: TransformTree,
    on_messages: Callable[[int], None] | None = None,
    until_ns: int | None = None,
    since_ns: int | None = None,
) -> None:
    """Commit all messages of a recording; what no tree accepts is left out and counted.

    Args:
        recording: Where they come from. Its counters say what was left out.
        tree: Where they go. It keeps all of them if it was made with `OPTIONS`.
        on_messages: Called with the number of messages committed, now and then.
        until_ns: Leave out what was recorded later, in nanoseconds, so that the tree knows what a
            live one knew at that time, which is "now" for its estimates; None for nothing.
        since_ns: As of `Recording.blocks`.

    Raises:
        RecordingError: The recording is damaged, or has no transforms by then, or its log has
            another clock than its stamps.
        LimitExceeded: The tree's memory is full, or it has too many frames.
    """
    done = 0
    for block in recording.blocks(until_ns, since_ns):
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
    """Commit rows in as many commits as it needs, without the rows that the tree rejects, which
    the recording counts. Yields the rows of each commit."""
    for commit in commit_parts(rows):
        valid = 0
        for part in _commit_valid(tree, commit, static):
            valid += len(part)
            if not static:
                first_ns, last_ns = int(part.stamp.min()), int(part.stamp.max())
                known = recording.range_ns or (first_ns, last_ns)
                recording.range_ns = min(known[0], first_ns), max(known[1], last_ns)
            yield part
        recording.skipped += len(commit) - valid


def _commit_valid(
    tree: TransformTree, rows: TransformRows, static: bool
) -> Iterator[TransformRows]:
    """Commit rows at one instant, without those that the tree rejects.

    Only the tree knows what it rejects: the rows are halved until the bad ones are alone.
    """
    count = len(rows)
    if not count:
        return
    try:
        tree._commit_rows(rows, static=static, drop_old=True)
    except (InvalidArgumentException, LimitExceeded) as error:
        if error.field in _FULL:
            raise
        if count > 1:
            yield from _commit_valid(tree, rows[: count // 2], static)
            yield from _commit_valid(tree, rows[count // 2 :], static)
    else:
        yield rows
