"""``zenoh-tf query``: ask a recording, without a server."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import (
    FrameInfo,
    LimitExceeded,
    StampedTransform,
    TransformArray,
    TransformTree,
    export,
)
from zenoh_tf.recordings import MAX_MEMORY_BYTES, OPTIONS, load
from zenoh_tf.text import quoted
from zenoh_tf_tools import stamps
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.progress import Progress
from zenoh_tf_tools.cli.types import Commands, examples
from zenoh_tf_tools.errors import CommandError, keep_input

_TIMES: Final = (
    "nanoseconds; seconds, as 1700000000.5 or 12s; or with a sign: +1.5s after the first sample, "
    "-2s before the last"
)
_TIME: Final = re.compile(r"(?P<sign>[+-])?(?P<number>\d+\.?\d*|\.\d+)(?P<unit>s|ns)?")
_STEP: Final = re.compile(r"(?P<number>\d+\.?\d*|\.\d+)(?P<unit>s|ms|us|ns)")
_UNITS: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
#: The last time that a stamp can say.
_MAX_NS: Final = (1 << 63) - 1
#: Rows of one answer; 100 bytes each.
_MAX_ROWS: Final = 10_000_000
#: A clock that is far from every stamp: a recording has no delays.
_NO_CLOCK_NS: Final = -(1 << 62)
_COLUMNS: Final = ("stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw")


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    query = commands.add_parser(
        "query",
        parents=[common],
        help="ask a recording, without a server",
        description="Print the pose of SOURCE in TARGET from a recording: at a time, or at many.\n"
        "Without --at and --every: at the latest common time. Without frames: what\n"
        "frames there are. Needs no server, and the libraries of zenoh-tf[recordings].",
        **examples(
            "zenoh-tf query run.mcap",
            "zenoh-tf query run.mcap map base --at +10s",
            "zenoh-tf query run.mcap map base --every 20ms --csv > base.csv",
            "zenoh-tf query run.mcap map base --every 20ms --npz base.npz",
        ),
    )
    recorded.add_file(query)
    query.add_argument(
        "target", metavar="TARGET", nargs="?", help="the frame to express the pose in"
    )
    query.add_argument("source", metavar="SOURCE", nargs="?", help="the frame whose pose is asked")
    when = query.add_mutually_exclusive_group()
    when.add_argument("--at", metavar="STAMP", type=_time, help=_TIMES)
    when.add_argument(
        "--every", metavar="STEP", type=_step, help="at all times this far apart, such as 20ms"
    )
    for option, meaning in (("--start", "first"), ("--end", "last")):
        query.add_argument(
            option,
            metavar="STAMP",
            type=_time,
            help=f"{meaning} time of --every, written as for --at (default: the {meaning} that all "
            "links can serve)",
        )
    form = query.add_mutually_exclusive_group()
    form.add_argument("--csv", action="store_true", help="print comma-separated values")
    form.add_argument(
        "--npz",
        metavar="OUT",
        type=Path,
        help="write NumPy arrays: stamps_ns (n,), translations (n, 3), rotations (n, 4)",
    )
    query.add_argument(
        "--max-memory-bytes",
        metavar="N",
        type=int,
        default=MAX_MEMORY_BYTES,
        help=f"most memory for the recording's samples (default {MAX_MEMORY_BYTES}; 0: no limit)",
    )
    query.set_defaults(run=_query, usage_error=query.error)


def _query(args: argparse.Namespace) -> int:
    if args.target is not None and args.source is None:
        args.usage_error("give both TARGET and SOURCE, or neither")
    if (args.start or args.end) and not args.every:
        args.usage_error("--start and --end belong to --every")
    keep_input(args.file, args.npz)
    tree = _load(args)
    if args.target is None:
        _print_frames(args, tree)
        return 0
    served = _range(tree, args.target, args.source)
    times = _times(args, served)
    array = tree.sample(args.target, args.source, times)
    if not array.ok.any():
        tree.lookup_transform(args.target, args.source, int(times[0]))  # its error tells why
    _print(args, array)
    return 0


def _load(args: argparse.Namespace) -> TransformTree:
    """The recording as a tree, read under a progress bar."""
    tree = TransformTree(**OPTIONS, max_memory_bytes=args.max_memory_bytes)
    with recorded.opened(args) as recording:
        with Progress(recording.message_count, "messages") as progress:
            try:
                load(recording, tree, progress.to)
            except LimitExceeded as error:
                raise CommandError(
                    f"{args.file}: {error}; allow more by --max-memory-bytes, or read less by "
                    "--topic"
                ) from error
        recorded.warn(recording)
    return tree


# --- times


class _RecordedTime:
    """A time as written: absolute, or relative to the recording's first or last sample."""

    def __init__(self, sign: str | None, time_ns: int) -> None:
        self._sign = sign
        self._time_ns = time_ns

    def resolve(self, served: tuple[int, int] | None) -> int:
        """The time in ns, of links that can serve this range; None if they are static."""
        if self._sign is None or served is None:
            return self._time_ns
        time_ns = served[0] + self._time_ns if self._sign == "+" else served[1] - self._time_ns
        if abs(time_ns) > _MAX_NS:
            raise CommandError(
                f"{stamps.seconds(time_ns)} s does not fit in 64 bits of nanoseconds: give a time "
                "nearer to the recording"
            )
        return time_ns


def _time(text: str) -> _RecordedTime:
    match = _TIME.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time; give {_TIMES}")
    sign, digits, unit = match["sign"], match["number"], match["unit"]
    # As everywhere, a plain integer is in nanoseconds; an offset is in seconds.
    seconds = unit == "s" or (unit is None and ("." in digits or sign is not None))
    # Decimal, because a double is too coarse for nanoseconds since 1970.
    time_ns = int(Decimal(digits) * (10**9 if seconds else 1))
    if time_ns > _MAX_NS:
        raise argparse.ArgumentTypeError(f"{text!r} is too large for 64 bits of nanoseconds")
    return _RecordedTime(sign, time_ns)


def _step(text: str) -> int:
    match = _STEP.fullmatch(text)
    step_ns = int(Decimal(match["number"]) * _UNITS[match["unit"]]) if match else 0
    if step_ns <= 0:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a length of time; give one with its unit, such as 20ms or 0.5s"
        )
    if step_ns > _MAX_NS:
        raise argparse.ArgumentTypeError(f"{text!r} is too large for 64 bits of nanoseconds")
    return step_ns


def _range(tree: TransformTree, target: str, source: str) -> tuple[int, int] | None:
    """The first and last time that all links between two frames can serve; None: all static."""
    last_ns = tree.latest_common_time(target, source)
    if last_ns is None:
        return None
    # Each link belongs to its child. A pair of neighbours has one.
    links = [
        tree.frame(a if tree.parent(a) == b else b) for a, b in pairwise(tree.chain(target, source))
    ]
    first_ns = max((link.oldest_stamp_ns for link in _moving(links)), default=last_ns)
    # Links that took the place of others have no samples of before.
    return min(first_ns, last_ns), last_ns


class _Moving(NamedTuple):
    oldest_stamp_ns: int
    newest_stamp_ns: int


def _moving(frames: Iterable[FrameInfo]) -> list[_Moving]:
    """The times of the frames that have samples of their own."""
    return [
        _Moving(frame.oldest_stamp_ns, frame.newest_stamp_ns)
        for frame in frames
        if not frame.static
        and frame.oldest_stamp_ns is not None
        and frame.newest_stamp_ns is not None
    ]


def _times(args: argparse.Namespace, served: tuple[int, int] | None) -> NDArray[np.int64]:
    """The times to ask for; `served` is the range that all links can serve."""
    if args.every is None:
        at_ns = args.at.resolve(served) if args.at else served[1] if served else 0
        return np.array([at_ns], np.int64)
    if served is None:
        raise CommandError(
            f"all links between {quoted(args.target)} and {quoted(args.source)} are static: their "
            "pose is the same at all times; ask for it without --every"
        )
    start = args.start.resolve(served) if args.start else served[0]
    end = args.end.resolve(served) if args.end else served[1]
    if end < start:
        raise CommandError(f"--end ({stamps.seconds(end)} s) is before {stamps.seconds(start)} s")
    count = (end - start) // args.every + 1
    if count > _MAX_ROWS:
        raise CommandError(
            f"{count:,} times are more than {_MAX_ROWS:,}: give a longer --every, or --start and "
            "--end"
        )
    times: NDArray[np.int64] = start + args.every * np.arange(count, dtype=np.int64)
    return times


# --- output


def _print(args: argparse.Namespace, array: TransformArray) -> None:
    missing = len(array) - int(array.ok.sum())
    if missing:
        print(
            f"zenoh-tf: no answer at {missing:,} of {len(array):,} times, which are left out",
            file=sys.stderr,
        )
        array = array[array.ok]
    if args.npz:
        _write_npz(args.npz, array)
    elif args.csv:
        print(",".join(_COLUMNS))
        for row in _rows(array):
            print(*row, sep=",")
    elif args.json:
        answers = [output.answer_document(answer) for answer in _answers(args, array)]
        output.print_json(answers if args.every else answers[0])
    elif args.every:
        print("".join(f"{name:>12}" for name in ("time [s]", "", *_COLUMNS[1:])).strip())
        for stamp_ns, *pose in _rows(array):
            print(f"{stamps.seconds(stamp_ns):>20}", *(f"{number:11.6f}" for number in pose))
    else:
        print(output.answer_text(next(_answers(args, array))))


def _rows(array: TransformArray) -> Iterator[tuple[Any, ...]]:
    """(stamp in ns, x, y, z, qx, qy, qz, qw) of each row, as Python's numbers."""
    columns = (array.stamps_ns, *array.translations.T, *array.rotations.T)
    return zip(*(column.tolist() for column in columns), strict=True)


def _answers(args: argparse.Namespace, array: TransformArray) -> Iterator[StampedTransform]:
    for stamp_ns, transform in zip(array.stamps_ns.tolist(), array, strict=True):
        yield StampedTransform(args.target, args.source, stamp_ns, transform)


def _write_npz(path: Path, array: TransformArray) -> None:
    try:
        with path.open("wb") as file:
            np.savez(
                file,
                stamps_ns=array.stamps_ns,
                translations=array.translations,
                rotations=array.rotations,
            )
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror}") from error
    print(f"{len(array):,} poses written to {path}")


def _print_frames(args: argparse.Namespace, tree: TransformTree) -> None:
    frames = [tree.frame(name) for name in tree.frames()]
    if args.json:
        output.print_json({"frames": [asdict(frame) for frame in frames]})
        return
    if moving := _moving(frames):
        first_ns = min(times.oldest_stamp_ns for times in moving)
        last_ns = max(times.newest_stamp_ns for times in moving)
        length = stamps.age(last_ns - first_ns)
        print(f"{stamps.seconds(first_ns)} s to {stamps.seconds(last_ns)} s ({length})")
    print(export.text(frames, _NO_CLOCK_NS, paint=output.paint))
