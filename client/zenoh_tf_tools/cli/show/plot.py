"""``zenoh-tf plot``: pose, velocity and age of pairs of frames over time, as a figure."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf.text import printable
from zenoh_tf.text.time_flags import RECORDED_TIMES
from zenoh_tf.text.times import age as age_text
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.arguments import Commands, add_duration, add_frames
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.show import view
from zenoh_tf_tools.cli.show.pair_delays import add_pairs
from zenoh_tf_tools.errors import CommandError, extra
from zenoh_tf_tools.plotting.lookups import PairHistory, follow, pose_error, replayed

#: How long a server is followed.
_FOLLOW_S: Final = 10.0
_FORMATS: Final = (".png", ".svg", ".pdf")


def add(commands: Commands) -> None:
    plot = commands.add(
        "plot",
        _plot,
        "draw pose, velocity and age of SOURCE in TARGET over time, as PNG",
        "Draw the position and rotation of SOURCE in TARGET over time, and how old the newest "
        "sample of the oldest link was. From a server: for some seconds from now on, the newest "
        "sample of each link. From a recording: all of it, interpolated. A second pair is drawn "
        "with dashed lines into the same panels. Times without an answer are shaded red. Needs the "
        "library of zenoh-tf[plot], and for FILE those of zenoh-tf[recordings].",
        "zenoh-tf plot map base_link",
        "zenoh-tf plot map base_link --velocity --for 1min --out base.png",
        "zenoh-tf plot run.mcap map base_link --start +2s --end -1s",
        "zenoh-tf plot run.mcap map base_link --pair map truth --error",
    )
    recorded.add_optional_file(plot)
    add_frames(plot)
    add_pairs(plot, "also draw this pair")
    plot.add_argument(
        "--velocity",
        action="store_true",
        help="also draw the velocities of SOURCE as seen from TARGET, averaged over 100 ms",
    )
    plot.add_argument(
        "--error",
        action="store_true",
        help="also draw how far TARGET SOURCE is from the pair of --pair, such as the true pose",
    )
    recorded.add_range(plot, f"{{0}} time of FILE that is drawn: {RECORDED_TIMES}")
    help_ = "how long to follow a server (default 10s, at most 1h)"
    add_duration(plot, "--for", help_, high_s=3600.0)
    plot.add_argument(
        "--out",
        metavar="OUT",
        type=_figure,
        default=Path("plot.png"),
        help="the file to write: .png, .svg or .pdf (default plot.png)",
    )


def _plot(args: argparse.Namespace) -> int:
    _check_usage(args)
    with extra("plot", "matplotlib"):
        from zenoh_tf_tools.plotting.figure import save  # noqa: PLC0415 - an optional extra
    if not args.out.parent.is_dir():
        raise CommandError(f"{args.out}: there is no folder {args.out.parent}")
    if args.file is not None and args.out.exists() and args.out.samefile(args.file):
        raise CommandError(f"{args.out}: this is the recording itself; give another --out")
    histories = _histories(args)
    for history in histories:
        if not history.answered.any() and history.error is not None:
            raise history.error
    found = pose_error(*(each.poses for each in histories)) if args.error else None
    try:
        save(histories, args.out, found)
    except OSError as error:
        raise CommandError(f"{args.out}: {error.strerror or error}") from error
    _report(args, histories, found)
    return 0


def _check_usage(args: argparse.Namespace) -> None:
    if len(args.pairs) > 1:
        args.usage_error("--pair can be given once: a figure has two pairs at most")
    if args.error and not args.pairs:
        args.usage_error("--error compares two pairs: give the other one by --pair")
    if args.file is None and (args.start or args.end):
        args.usage_error("--start and --end choose times of a recording: give its FILE")
    if args.file is not None and args.for_s is not None:
        args.usage_error("--for follows a server; of FILE choose times by --start and --end")


def _histories(args: argparse.Namespace) -> list[PairHistory]:
    pairs = [(args.target, args.source), *((target, source) for target, source in args.pairs)]
    if args.file is not None:
        source = view.recorded(args)
        range_ns = recorded.chosen_range(args, source.range_ns, source.range_ns, inside=True)
        return replayed(source, pairs, range_ns, velocity=args.velocity)
    with connect(args) as tf, tf.mirror() as mirror:
        follow_s = _FOLLOW_S if args.for_s is None else args.for_s
        return follow(mirror, pairs, follow_s, velocity=args.velocity)


def _report(args: argparse.Namespace, histories: list[PairHistory], found: Any | None) -> None:
    first, *others = histories
    figures = _figures(first)
    document = {"file": str(args.out), **figures}
    span = f"{figures['lookups']:,} lookups over {first.times_s[-1]:.1f} s, "
    lines = _lines(f"{args.out}: {span}", first, figures)
    for other in others:
        figures = _figures(other)
        document["pair"] = {"target": other.target, "source": other.source, **figures}
        name = f"{printable(other.source)} in {printable(other.target)}"
        lines += _lines(f"{name}: ", other, figures)
    if found is not None:
        numbers = (*_median_and_greatest(found[0]), *_median_and_greatest(np.degrees(found[1])))
        keys = ("median_error_m", "greatest_error_m", "median_error_deg", "greatest_error_deg")
        document |= dict(zip(keys, numbers, strict=True))
        lines.append(_error_text(*numbers))
    output.show(args, document, "\n".join(lines))


def _lines(begin: str, history: PairHistory, figures: dict[str, Any]) -> list[str]:
    """The figures of a pair as text."""
    ages_s = figures["median_age_s"], figures["greatest_age_s"]
    if ages_s == (None, None):
        lines = [f"{begin}all links are static"]
    else:
        median, greatest = (age_text(int(each * 1e9)) for each in ages_s)
        lines = [f"{begin}age {median} (median), {greatest} at most"]
    if failed := figures["failed"]:
        text = f"{failed:,} lookups without an answer; the last: {history.error}"
        lines.append(printable(text))
    return lines


def _figures(history: PairHistory) -> dict[str, Any]:
    median_s, greatest_s = _median_and_greatest(history.ages_s)
    return {
        "lookups": len(history.times_s),
        "failed": int(np.count_nonzero(~history.answered)),
        "seconds": round(float(history.times_s[-1]), 3),
        "median_age_s": median_s,
        "greatest_age_s": greatest_s,
    }


def _error_text(
    median_m: float | None,
    greatest_m: float | None,
    median_deg: float | None,
    greatest_deg: float | None,
) -> str:
    if median_m is None:
        return "error: none, as the pairs never have an answer at the same time"
    return (
        f"error: {median_m:.4g} m (median), {greatest_m:.4g} m at most; "
        f"{median_deg:.4g} deg (median), {greatest_deg:.4g} deg at most"
    )


def _median_and_greatest(values: NDArray[np.float64]) -> tuple[float | None, float | None]:
    """Without the NaNs; None if there is nothing else."""
    known = values[~np.isnan(values)]
    return (float(np.median(known)), float(known.max())) if len(known) else (None, None)


def _figure(text: str) -> Path:
    if Path(text).suffix not in _FORMATS:
        raise argparse.ArgumentTypeError(f"{text!r} does not end with one of {', '.join(_FORMATS)}")
    return Path(text)
