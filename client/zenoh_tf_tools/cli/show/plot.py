"""``zenoh-tf plot``: pose and age of a pair of frames over time, as a figure."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

import numpy as np

from zenoh_tf.text.flag_values import duration
from zenoh_tf.text.times import age as age_text
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.show.view import recorded
from zenoh_tf_tools.cli.types import Commands, examples
from zenoh_tf_tools.errors import CommandError, keep_input
from zenoh_tf_tools.plotting.pair import PairHistory, follow, replayed

_FORMATS: Final = (".png", ".svg", ".pdf")
_EXAMPLES: Final = (
    "zenoh-tf plot map base_link",
    "zenoh-tf plot map base_link --for 1min --out base.png",
    "zenoh-tf plot map base_link run.mcap",
)


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    plot = commands.add_parser(
        "plot",
        parents=[common],
        help="draw pose and age of SOURCE in TARGET over time, as PNG",
        description="Draw the position and rotation of SOURCE in TARGET over time, and how old the "
        "newest sample of the oldest link was. From a server: for some seconds from now on, the "
        "newest sample of each link. From a recording: all of it, interpolated. Times without an "
        "answer are shaded red. Needs the library of zenoh-tf[plot], and for FILE those of "
        "zenoh-tf[recordings].",
        **examples(*_EXAMPLES),
    )
    plot.add_argument("target", metavar="TARGET", help="the frame to express the pose in")
    plot.add_argument("source", metavar="SOURCE", help="the frame whose pose is drawn")
    plot.add_argument(
        "file",
        metavar="FILE",
        nargs="?",
        type=Path,
        help="a recording to draw in place of a server",
    )
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
    plot.set_defaults(run=_plot, topics=None)


def _plot(args: argparse.Namespace) -> int:
    try:
        from zenoh_tf_tools.plotting.figure import save  # noqa: PLC0415 - an optional extra
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != "matplotlib":
            raise
        raise CommandError(
            "plot draws with matplotlib, which is not installed; "
            "install it with: pip install 'zenoh-tf[plot]'"
        ) from error
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
    median_s, most_s = (float(np.median(ages_s)), float(ages_s.max())) if len(ages_s) else (0, 0)
    if args.json:
        output.print_json(
            {
                "file": str(args.out),
                "lookups": lookups,
                "failed": failed,
                "seconds": round(float(history.times_s[-1]), 3),
                "median_age_s": median_s if len(ages_s) else None,
                "greatest_age_s": most_s if len(ages_s) else None,
            }
        )
        return
    age = (
        f"age {age_text(int(median_s * 1e9))} (median), {age_text(int(most_s * 1e9))} at most"
        if len(ages_s)
        else "all links are static"
    )
    print(f"{args.out}: {lookups:,} lookups over {history.times_s[-1]:.1f} s, {age}")
    if failed:
        print(f"{failed:,} lookups without an answer; the last: {history.error}")


def _figure(text: str) -> Path:
    if Path(text).suffix not in _FORMATS:
        raise argparse.ArgumentTypeError(f"{text!r} does not end with one of {', '.join(_FORMATS)}")
    return Path(text)
