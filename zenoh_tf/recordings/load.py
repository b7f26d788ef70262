"""Commits a recording to a tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final

from .._core import TransformRows
from ..errors import InvalidArgumentException, LimitExceeded
from ..wire import commit_parts
from .recording import Recording

if TYPE_CHECKING:
    from ..tree import TransformTree

#: Most bytes of all samples of a tree from a recording, unless the caller says otherwise.
MAX_MEMORY_BYTES: Final = 4 << 30
#: Options of a tree that keeps a recording as a whole: the most that the core allows.
OPTIONS: Final[dict[str, Any]] = {"cache_time_s": 1e9, "max_samples_per_frame": 1 << 30}

#: Limits that no other row would keep either.
_FULL: Final = ("max_memory", "max_frames")


def load(
    recording: Recording, tree: TransformTree, on_messages: Callable[[int], None] | None = None
) -> None:
    """Commit all messages of a recording; what no tree accepts is left out and counted.

    Args:
        recording: Where they come from. Its counters say what was left out.
        tree: Where they go. It keeps all of them if it was made with `OPTIONS`.
        on_messages: Told how many messages were committed, now and then.

    Raises:
        RecordingError: The recording is damaged, or has no transforms.
        LimitExceeded: The tree's memory is full, or it has too many frames.
    """
    done = 0
    for block in recording.blocks():
        for _ in valid_commits(recording, tree, block.rows, block.static):
            pass
        done += block.messages
        if on_messages is not None:
            on_messages(done)


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
