"""``zenoh-tf plot``: pose and age of a pair of frames over time, as a figure."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

import numpy as np

from zenoh_tf.text.flag_values import duration
from zenoh_tf.text.times import age as age_text
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_frames, add_optional_file
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.show.view import recorded
from zenoh_tf_tools.errors import CommandError, extra, keep_input
from zenoh_tf_tools.plotting.pair import PairHistory, follow, replayed

_FORMATS: Final = (".png", ".svg", ".pdf")


def add(commands: Commands) -> None:
    plot = commands.add(
        "plot",
        _plot,
        "draw pose and age of SOURCE in TARGET over time, as PNG",
        "Draw the position and rotation of SOURCE in TARGET over time, and how old the newest "
        "sample of the oldest link was. From a server: for some seconds from now on, the newest "
        "sample of each link. From a recording: all of it, interpolated. Times without an answer "
        "are shaded red. Needs the library of zenoh-tf[plot], and for FILE those of "
        "zenoh-tf[recordings].",
        "zenoh-tf plot map base_link",
        "zenoh-tf plot map base_link --for 1min --out base.png",
        "zenoh-tf plot map base_link run.mcap",
    )
    add_frames(plot)
    add_optional_file(plot)
    plot.add_argument(
        "--for",
        dest="follow_s",
        metavar="DURATION",
        type=duration(0.0, 3600.0),
        default=10.0,
        help="how long to follow a server (default 10s, at most 1h)",
    )
    plot.add_argument(
        "--out",
        metavar="OUT",
        type=_figure,
        default=Path("plot.png"),
        help="the file to write: .png, .svg or .pdf (default plot.png)",
    )


def _plot(args: argparse.Namespace) -> int:
    with extra("plot", "matplotlib"):
        from zenoh_tf_tools.plotting.figure import save  # noqa: PLC0415 - an optional extra
    if not args.out.parent.is_dir():
        raise CommandError(f"{args.out}: there is no folder {args.out.parent}")
    keep_input(args.file, args.out)
    history = _history(args)
    if not history.answered.any() and history.error is not None:
        raise history.error
    try:
        save(history, args.target, args.source, args.out)
    except OSError as error:
        raise CommandError(f"{args.out}: {error.strerror or error}") from error
    _report(args, history)
    return 0


def _history(args: argparse.Namespace) -> PairHistory:
    if args.file is not None:
        return replayed(recorded(args), args.target, args.source)
    with connect(args) as tf, tf.mirror() as mirror:
        return follow(mirror, args.target, args.source, args.follow_s)


def _report(args: argparse.Namespace, history: PairHistory) -> None:
    ages_s = history.ages_s[~np.isnan(history.ages_s)]
    lookups, failed = len(history.times_s), int(np.count_nonzero(~history.answered))
    seconds = float(history.times_s[-1])
    median_s = greatest_s = None
    age = "all links are static"
    if len(ages_s):
        median_s, greatest_s = float(np.median(ages_s)), float(ages_s.max())
        median, greatest = (age_text(int(each * 1e9)) for each in (median_s, greatest_s))
        age = f"age {median} (median), {greatest} at most"
    text = f"{args.out}: {lookups:,} lookups over {seconds:.1f} s, {age}"
    if failed:
        text += f"\n{failed:,} lookups without an answer; the last: {history.error}"
    document = {
        "file": str(args.out),
        "lookups": lookups,
        "failed": failed,
        "seconds": round(seconds, 3),
        "median_age_s": median_s,
        "greatest_age_s": greatest_s,
    }
    output.show(args, document, text)


def _figure(text: str) -> Path:
    if Path(text).suffix not in _FORMATS:
        raise argparse.ArgumentTypeError(f"{text!r} does not end with one of {', '.join(_FORMATS)}")
    return Path(text)
