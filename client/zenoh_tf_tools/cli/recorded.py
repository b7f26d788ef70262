"""What the commands that read recordings have in common."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TypeVar

from zenoh_tf import ConnectivityException, LimitExceeded, LookupException, TransformTree
from zenoh_tf.recordings import (
    MAX_MEMORY_BYTES,
    OPTIONS,
    Recording,
    load,
    open_recording,
)
from zenoh_tf.text import printable
from zenoh_tf.text.time_flags import LIVE_TIMES, RECORDED_TIMES, RecordedTime, recorded_time
from zenoh_tf.text.times import seconds
from zenoh_tf_tools.cli.progress import Progress
from zenoh_tf_tools.errors import CommandError

T = TypeVar("T")


def add_file(parser: argparse.ArgumentParser) -> None:
    """Add the recording, and what to read of it."""
    parser.add_argument(
        "file", metavar="FILE", type=Path, help="MCAP, db3 or bag file, or a ROS 2 folder"
    )
    _add_topics(parser)


def add_optional_file(parser: argparse.ArgumentParser) -> None:
    """Add the recording of a command that otherwise asks a server."""
    parser.add_argument(
        "file",
        metavar="FILE",
        nargs="?",
        type=Path,
        help="a recording (MCAP, db3, ROS 1 bag) in place of a server",
    )
    _add_topics(parser)


def _add_topics(parser: argparse.ArgumentParser) -> None:
    """Add what to read of a recording."""
    parser.add_argument(
        "--topic",
        metavar="NAME",
        dest="topics",
        action="append",
        help="read only this topic of FILE, such as /robot1/tf, or /odom with its poses; may be "
        "given several times (default: all topics with transforms)",
    )
    parser.add_argument(
        "--prefix",
        metavar="TOPIC=NAME",
        dest="prefixes",
        type=_prefix,
        action="append",
        default=[],
        help="read the frames of this topic of FILE as NAME/frame, such as /tf_gt=truth; may be "
        "given several times (that of /robot1/tf is also that of /robot1/tf_static)",
    )


def _prefix(text: str) -> tuple[str, str]:
    topic, _, name = text.rpartition("=")
    if not topic.strip("/") or not name.strip("/"):
        raise argparse.ArgumentTypeError(f"{text!r} is not TOPIC=NAME, such as /tf_gt=truth")
    return topic, name


def opened(args: argparse.Namespace, *, mixed: bool = False) -> AbstractContextManager[Recording]:
    """The recording that the arguments name, open; `mixed`: as of `open_recording`."""
    return open_recording(args.file, args.topics, dict(args.prefixes), mixed=mixed)


def add_range(parser: argparse.ArgumentParser, help_: str) -> None:
    """Add --start and --end; `help_`: with {0} for first or last."""
    for option, end in (("--start", "first"), ("--end", "last")):
        parser.add_argument(option, metavar="TIME", type=recorded_time, help=help_.format(end))


def add_at(parser: argparse.ArgumentParser) -> None:
    """Add --at of a command that asks a recording if FILE is given, else a server: `time_at` reads
    it."""
    parser.add_argument("--at", metavar="TIME", help=f"{LIVE_TIMES}; in FILE {RECORDED_TIMES}")


def time_at(args: argparse.Namespace, parse: Callable[[str], T], option: str = "--at") -> T | None:
    """The value of --at by the grammar of a recording or of a server; None if it is not given."""
    text = getattr(args, option.removeprefix("--"))
    try:
        return None if text is None else parse(text)
    except argparse.ArgumentTypeError as error:
        args.usage_error(f"argument {option}: {error}")
        raise AssertionError from error  # argparse has ended the process


def loaded(
    args: argparse.Namespace,
    max_memory_bytes: int = MAX_MEMORY_BYTES,
    advice: str = "",
) -> tuple[TransformTree, tuple[int, int] | None]:
    """The recording as a tree, and its first and last stamp, read under a progress bar.

    `advice`: what to do about a recording that is too large, for the error.
    """
    tree = TransformTree(**OPTIONS, max_memory_bytes=max_memory_bytes)
    with opened(args) as recording:
        with Progress(recording.message_count, "messages") as progress:
            try:
                load(recording, tree, progress.to)
            except LimitExceeded as error:
                raise CommandError(f"{args.file}: {error}{advice}") from error
        warn(recording)
    return tree, recording.range_ns


def range_of(recording: Recording) -> tuple[int, int] | None:
    """The first and last stamp of a recording, read under a progress bar; None if all is static."""
    with Progress(recording.message_count, "messages read") as progress:
        load(recording, validator(), progress.to)
    return recording.range_ns


def validator() -> TransformTree:
    """A tree with the server's rules, which rejects a message for one bad row; it need not keep
    anything."""
    return TransformTree(cache_time_s=0.001)


def chosen_range(
    args: argparse.Namespace,
    range_ns: tuple[int, int],
    default: tuple[int, int],
    *,
    inside: bool = False,
) -> tuple[int, int]:
    """The times of --start and --end in nanoseconds; arguments and errors as of `stamp_ns`."""
    start_ns = stamp_ns("--start", args.start, range_ns, default[0], inside=inside)
    end_ns = stamp_ns("--end", args.end, range_ns, default[1], inside=inside)
    if end_ns < start_ns:
        raise CommandError(f"--end ({seconds(end_ns)} s) is before {seconds(start_ns)} s")
    return start_ns, end_ns


def stamp_ns(
    option: str,
    time: RecordedTime | None,
    range_ns: tuple[int, int],
    default: int,
    *,
    inside: bool = False,
) -> int:
    """The time of an option in nanoseconds.

    Args:
        option: Its name, for errors.
        time: What it says; None if it is not given.
        range_ns: The recording's first and last stamp.
        default: The time if it is not given.
        inside: Whether a stamp must be one of the recording: else it was meant relative to it.

    Raises:
        CommandError: The time does not fit in a stamp, or must be inside and is not.
    """
    if time is None:
        return default
    first_ns, last_ns = range_ns
    stamp = time.stamp_ns(first_ns, last_ns)
    if abs(stamp) >= 1 << 63:
        raise CommandError(
            f"{option} {time.text}: {seconds(stamp)} s does not fit in 64 bits of nanoseconds; "
            "give a time nearer to the recording"
        )
    if inside and not time.sign and not first_ns <= stamp <= last_ns:
        raise CommandError(
            f"{option} {time.text} is the stamp {seconds(stamp)} s, but the recording is from "
            f"{seconds(first_ns)} s to {seconds(last_ns)} s; +10s and -2s count from there"
        )
    return stamp


def warn(recording: Recording) -> None:
    """Print on stderr what was wrong with the recording."""
    for warning in recording.warnings():
        print(f"zenoh-tf: {printable(warning)}", file=sys.stderr)


@contextmanager
def noting_statics(tree: TransformTree) -> Iterator[None]:
    """Adds to the error of a lookup that its recording has no static links, as one reason why
    frames are missing."""
    try:
        yield
    except (LookupException, ConnectivityException) as error:
        if not any(tree.frame(name).static for name in tree.frames()):
            error.add_note(
                "the recording has no static links: if it is in parts, often only the first one "
                "has them, so give the folder"
            )
        raise
