"""``zenoh-tf estimate``: a pose now, and how wrong it may be."""

from __future__ import annotations

import argparse
import sys
from typing import Final

import numpy as np

from zenoh_tf import (
    Estimate,
    FrameInfo,
    LimitExceeded,
    StampedTransform,
    TransformException,
    TransformTree,
)
from zenoh_tf.recordings import MAX_MEMORY_BYTES, OPTIONS, load
from zenoh_tf.text import printable
from zenoh_tf.text.flag_values import angle, length, number
from zenoh_tf.text.time_flags import duration, live_time, recorded_time
from zenoh_tf.text.times import age
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.arguments import Commands, add_frames
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.estimate_words import bounds, carried_on, metres

#: Errors below this are of the arithmetic, and nothing would make them smaller.
_NO_ERROR_M: Final = 1e-6
_LEVEL: Final = 0.9


def add(commands: Commands) -> None:
    estimate = commands.add(
        "estimate",
        _estimate,
        "pose of SOURCE in TARGET now, and how wrong it may be",
        "Print the pose of SOURCE in TARGET now, by the server's clock, with bounds of its errors: "
        "links are carried on beyond their newest samples, and the same question about past "
        "instants says how wrong that has been. Exit code 3 if an error may exceed its limit.\n\n"
        "With FILE: the pose at a time of a recording, from what had been recorded by then. FILE "
        "needs the libraries of zenoh-tf[recordings].",
        "zenoh-tf estimate map gripper",
        "zenoh-tf estimate map gripper --max-error 2cm --max-angle 1deg && ./grasp",
        "zenoh-tf estimate map gripper --at now-50ms --level 0.99",
        "zenoh-tf estimate run.mcap map base_link --at +10s",
    )
    recorded.add_optional_file(estimate)
    add_frames(estimate)
    recorded.add_at(estimate)
    estimate.add_argument(
        "--known",
        metavar="TIME",
        help="with FILE: use only what had been recorded by then, written as for --at (default: "
        "the time of --at)",
    )
    add_options(estimate)
    estimate.add_argument(
        "--max-error",
        metavar="LENGTH",
        type=length,
        help="fail if the position may be off by more, such as 2cm",
    )
    estimate.add_argument(
        "--max-angle",
        metavar="ANGLE",
        type=angle(low=0.0),
        help="fail if the orientation may be off by more, such as 1deg",
    )


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the question itself, which `ask` reads."""
    parser.add_argument(
        "--level",
        metavar="N",
        type=number(0.0, 1.0, above=True),
        default=_LEVEL,
        help="share of answers whose error is within the bounds (default 0.9)",
    )
    parser.add_argument(
        "--max-by",
        metavar="DURATION",
        type=duration(),
        default=0.5,
        help="how far to carry a link beyond its newest sample at most (default 500ms)",
    )


def ask(tf: TransformClient, args: argparse.Namespace) -> Estimate:
    """The estimate for now that the arguments ask for, without limits."""
    return tf.estimate_transform(args.target, args.source, level=args.level, max_by_s=args.max_by)


def _estimate(args: argparse.Namespace) -> int:
    if args.file is None:
        if args.known is not None:
            args.usage_error("--known belongs to FILE")
        stamp_ns = recorded.time_at(args, live_time)
        with connect(args) as tf:
            _answer(args, tf, stamp_ns)
    else:
        tree, stamp_ns = _known_tree(args)
        with recorded.noting_statics(tree):
            _answer(args, tree, stamp_ns)
    return 0


def _known_tree(args: argparse.Namespace) -> tuple[TransformTree, int | None]:
    """The tree of what a recording had by the time of --known, and the time of --at."""
    at, known = (recorded.time_at(args, recorded_time, option) for option in ("--at", "--known"))
    tree = TransformTree(**OPTIONS, max_memory_bytes=MAX_MEMORY_BYTES)
    stamp_ns = known_ns = None
    with recorded.opened(args) as recording:
        range_ns = recorded.range_of(recording)
        if range_ns is not None:  # else all is static
            stamp_ns = recorded.stamp_ns("--at", at, range_ns, range_ns[1], inside=True)
            known_ns = recorded.stamp_ns("--known", known, range_ns, stamp_ns, inside=True)
        try:
            load(recording, tree, until_ns=known_ns)
        except LimitExceeded as error:
            raise CommandError(f"{args.file}: {error}") from error
        recorded.warn(recording)
    return tree, stamp_ns


def _answer(
    args: argparse.Namespace, tf: TransformTree | TransformClient, stamp_ns: int | None
) -> None:
    found = tf.estimate_transform(
        args.target,
        args.source,
        stamp_ns,
        level=args.level,
        max_by_s=args.max_by,
        max_error_m=args.max_error,
        max_error_rad=args.max_angle,
    )
    show(args, found, advice(tf, found))


def show(args: argparse.Namespace, found: Estimate, better: str | None = None) -> None:
    """Print an estimate, and what would make it better."""
    document_ = document(found) | ({} if better is None else {"advice": better})
    lines = [text(found)] + ([] if better is None else ["", printable(better)])
    output.show(args, document_, "\n".join(lines))


def show_again(args: argparse.Namespace, _: TransformClient, found: Estimate) -> None:
    """Print an estimate at once, as one of several."""
    show(args, found)
    sys.stdout.flush()


def document(found: Estimate) -> dict[str, object]:
    """An estimate as JSON values: metres, radians, nanoseconds."""
    return output.answer_document(_stamped(found)) | {
        "error_m": found.error_m,
        "error_rad": found.error_rad,
        "level": found.level,
        "backtests": found.backtests,
        "basis": found.basis,
        "by_ns": found.by_ns,
        "limiting_link": found.limiting_link,
        "predictor": dict(found.predictor),
    }


def text(found: Estimate) -> str:
    """An estimate as text."""
    lines = [output.answer_text(_stamped(found)), output.row("error", bounds(found))]
    if carried := carried_on(found):
        lines.append(output.row("carried on", carried))
    return "\n".join(lines)


def advice(tf: TransformTree | TransformClient, found: Estimate) -> str | None:
    """Which link an error comes from most, and what would make it smaller; None if nothing would.

    The link's part is that of its own error at the source's distance.
    """
    if found.limiting_link is None or found.error_m < _NO_ERROR_M:
        return None
    parent, child = found.limiting_link
    try:
        link = tf.frame(child)
        end = tf.estimate_transform(child, found.source_frame, found.stamp_ns).transform
        own = tf.estimate_transform(
            parent,
            child,
            found.stamp_ns,
            level=found.level or _LEVEL,
            radius_m=float(np.linalg.norm(end.translation)),
        )
        late_s = {each.name: each.stamp_age_s for each in tf.authorities()}.get(link.authority)
    except TransformException:  # the tree has changed
        return None
    if link.static:
        return None
    part = f"{metres(min(own.error_m, found.error_m))} of the {metres(found.error_m)}"
    sender = link.authority or "its publisher"
    return f"{parent} -> {child} makes {part}: {sender} {_sends(link, found, late_s)}."


def _sends(link: FrameInfo, found: Estimate, late_s: float | None) -> str:
    """How a link is published, and what to change about it."""
    rate = "" if link.rate_hz is None else f"publishes at {link.rate_hz:.3g} Hz"
    if late_s is None or late_s < 0:
        since = f"its newest sample is {age(found.by_ns)} older than the time asked for"
        return f"{rate}, and {since}" if rate else f"has sent one sample, and {since}"
    arrives = f"arrives {age(round(late_s * 1e9))} late"
    if not rate:
        return arrives
    periods = late_s * (link.rate_hz or 0.0)
    cure = "sooner" if periods > 2 else "more often" if periods < 0.5 else "sooner or more often"
    return f"{rate} and {arrives}; publish it {cure}"


def _stamped(found: Estimate) -> StampedTransform:
    return StampedTransform(found.target_frame, found.source_frame, found.stamp_ns, found.transform)
