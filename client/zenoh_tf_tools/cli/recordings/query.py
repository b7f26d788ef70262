"""``zenoh-tf query``: ask a recording, without a server."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import StampedTransform, TransformArray, TransformTree, export
from zenoh_tf.recordings import MAX_MEMORY_BYTES
from zenoh_tf.text import quoted
from zenoh_tf.text.flag_values import size, whole
from zenoh_tf.text.time_flags import RECORDED_TIMES, recorded_time
from zenoh_tf.text.times import age, seconds
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.arguments import Commands, add_duration, add_max_gap
from zenoh_tf_tools.errors import CommandError

#: Rows of one answer; 100 bytes each.
_MAX_ROWS: Final = 10_000_000
#: A clock that is far from every stamp: a recording has no delays.
_NO_CLOCK_NS: Final = -(1 << 62)
_COLUMNS: Final = ("stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw")


def add(commands: Commands) -> None:
    query = commands.add(
        "query",
        _query,
        "ask a recording, without a server",
        "Print the pose of SOURCE in TARGET from a recording: at a time, or at many. Without --at "
        "and --every: at the latest common time. Without frames: what frames there are. Needs no "
        "server, and the libraries of zenoh-tf[recordings].",
        "zenoh-tf query run.mcap",
        "zenoh-tf query run.mcap map base --at +10s",
        "zenoh-tf query run.mcap map base --every 20ms --csv > base.csv",
    )
    recorded.add_file(query)
    query.add_argument(
        "target", metavar="TARGET", nargs="?", help="the frame to express the pose in"
    )
    query.add_argument("source", metavar="SOURCE", nargs="?", help="the frame whose pose is asked")
    when = query.add_mutually_exclusive_group()
    when.add_argument("--at", metavar="TIME", type=recorded_time, help=RECORDED_TIMES)
    add_duration(when, "--every", "at all times this far apart, such as 20ms", low_s=1e-9)
    when.add_argument(
        "--count",
        metavar="N",
        type=whole(2, _MAX_ROWS),
        help="at so many times, evenly from the first to the last",
    )
    recorded.add_range(
        query,
        "{0} time of --every and --count, written as for --at (default: the {0} that all links "
        "can serve)",
    )
    add_max_gap(query)
    query.add_argument("--csv", action="store_true", help="print comma-separated values")
    query.add_argument(
        "--max-memory",
        metavar="BYTES",
        type=size(),
        default=MAX_MEMORY_BYTES,
        help="most memory for the recording's samples, such as 512MB or 8G (default 4G)",
    )


def _query(args: argparse.Namespace) -> int:
    if args.target is not None and args.source is None:
        args.usage_error("give both TARGET and SOURCE, or neither")
    args.is_series = args.every_s is not None or args.count is not None
    if (args.start or args.end) and not args.is_series:
        args.usage_error("--start and --end belong to --every and --count")
    advice = "; allow more by --max-memory, or read less by --topic"
    tree, range_ns = recorded.loaded(args, args.max_memory, advice)
    if args.target is None:
        _print_frames(args, tree, range_ns)
        return 0
    with recorded.noting_statics(tree):
        served = _range(tree, args.target, args.source)
    times = _times(args, range_ns or (0, 0), served)
    pair, max_gap_s = (args.target, args.source), args.max_gap_s
    array = tree.sample(*pair, times, max_gap_s=max_gap_s)
    if not array.ok.any():  # raises the reason
        tree.lookup_transform(*pair, int(times[0]), max_gap_s=max_gap_s)
    _print(args, array, static=served is None and args.at is None)
    return 0


# --- times


def _range(tree: TransformTree, target: str, source: str) -> tuple[int, int] | None:
    """The first and last time that all links between two frames can serve; None: all static."""
    last_ns = tree.latest_common_time(target, source)
    if last_ns is None:
        return None
    links = tree.explain(target, source).links
    firsts_ns = [link.oldest_stamp_ns for link in links if link.oldest_stamp_ns is not None]
    # Links that took the place of others have no samples of before.
    return min(max(firsts_ns, default=last_ns), last_ns), last_ns


def _times(
    args: argparse.Namespace, range_ns: tuple[int, int], served: tuple[int, int] | None
) -> NDArray[np.int64]:
    """The times to ask for; `range_ns`: the recording's first and last stamp; `served`: those that
    all links can serve, None if they are static."""
    if not args.is_series:
        latest_ns = served[1] if served else 0
        return np.array([recorded.stamp_ns("--at", args.at, range_ns, latest_ns)], np.int64)
    if served is None:
        raise CommandError(
            f"all links between {quoted(args.target)} and {quoted(args.source)} are static: their "
            "pose is the same at all times; ask for it without --every and --count"
        )
    start, end = recorded.chosen_range(args, range_ns, served)
    if args.count is not None:
        # In integers: a double cannot represent nanoseconds since 1970.
        steps = np.arange(args.count, dtype=np.int64)
        whole_ns, rest_ns = divmod(end - start, args.count - 1)
        evenly: NDArray[np.int64] = start + steps * whole_ns + steps * rest_ns // (args.count - 1)
        return evenly
    step_ns = round(args.every_s * 1e9)
    count = (end - start) // step_ns + 1
    if count > _MAX_ROWS:
        raise CommandError(
            f"{count:,} times are more than {_MAX_ROWS:,}: give a longer --every, or --start and "
            "--end"
        )
    times: NDArray[np.int64] = start + step_ns * np.arange(count, dtype=np.int64)
    return times


# --- output


def _print(args: argparse.Namespace, array: TransformArray, *, static: bool) -> None:
    missing = len(array) - int(array.ok.sum())
    if missing:
        print(
            f"zenoh-tf: no answer at {missing:,} of {len(array):,} times, which are left out",
            file=sys.stderr,
        )
        array = array[array.ok]
    if args.csv:
        print(",".join(_COLUMNS))
        for row in _rows(array):
            print(*row, sep=",")
    elif args.json:
        answers = [output.answer_document(answer) for answer in _answers(args, array)]
        output.print_json(answers if args.is_series else answers[0])
    elif args.is_series:
        print("".join(f"{name:>12}" for name in ("time [s]", "", *_COLUMNS[1:])).strip())
        for stamp_ns, *pose in _rows(array):
            print(f"{seconds(stamp_ns):>20}", *(f"{number:11.6f}" for number in pose))
    else:
        print(output.answer_text(next(_answers(args, array)), static=static))


def _rows(array: TransformArray) -> Iterator[tuple[Any, ...]]:
    """(stamp in ns, x, y, z, qx, qy, qz, qw) of each row, as Python's numbers."""
    columns = (array.stamps_ns, *array.translations.T, *array.rotations.T)
    return zip(*(column.tolist() for column in columns), strict=True)


def _answers(args: argparse.Namespace, array: TransformArray) -> Iterator[StampedTransform]:
    stamps, gaps = array.stamps_ns.tolist(), array.gaps_ns.tolist()
    for stamp_ns, gap_ns, transform in zip(stamps, gaps, array, strict=True):
        yield StampedTransform(args.target, args.source, stamp_ns, transform, gap_ns=gap_ns)


def _print_frames(
    args: argparse.Namespace, tree: TransformTree, range_ns: tuple[int, int] | None
) -> None:
    frames = [tree.frame(name) for name in tree.frames()]
    if args.json:
        output.print_json({"frames": [asdict(frame) for frame in frames]})
        return
    if range_ns is not None:
        first_ns, last_ns = range_ns
        print(f"{seconds(first_ns)} s to {seconds(last_ns)} s ({age(last_ns - first_ns)})")
    print(export.text(frames, _NO_CLOCK_NS, paint=output.paint))
