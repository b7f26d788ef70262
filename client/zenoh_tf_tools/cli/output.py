"""What commands print: JSON documents, lists of facts, poses and colours."""

from __future__ import annotations

import argparse
import functools
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from typing import Protocol, TextIO

from zenoh_tf import LatestTransform, StampedTransform, TransformException, Velocity
from zenoh_tf.text import printable
from zenoh_tf.text.times import CLOCK_RANGE_S, age, seconds

#: Terminal colours: bold, faint, green, yellow, bold red, cyan; other parts have none.
_COLOURS = {
    "frame": "1",
    "branch": "2",
    "header": "2",
    "authority": "2",
    "fresh": "32",
    "late": "33",
    "counted": "33",
    "stopped": "1;31",
    "static": "36",
}


#: The branches of `zenoh_tf.export.text`, as wide in ASCII.
_ASCII_BRANCHES = str.maketrans("│├└─", "||`-")


def print_json(document: object, file: TextIO | None = None) -> None:
    """Print one JSON document on one line, to ``file`` or stdout."""
    stream = file or sys.stdout
    # Only escapes are sure to be valid JSON in an encoding that lacks a character.
    print(json.dumps(document, ensure_ascii=not is_unicode(stream), allow_nan=False), file=stream)


def print_error(name: str, message: str, fields: object, *, as_json: bool, shown: str) -> None:
    """Print an error on stderr: as a JSON object, or `shown` as one line."""
    if as_json:
        print_json({"type": name, "message": message, "fields": fields}, file=sys.stderr)
    else:
        line = printable(" ".join(shown.split()))
        print(f"zenoh-tf: {line}", file=sys.stderr, flush=True)


def report_waiting(error: TransformException, as_json: bool) -> None:
    """Print on stderr why a command that continues has nothing to show."""
    name, message = type(error).__name__, str(error)
    shown = f"{name}: {message} (waiting)"
    print_error(name, message, error.facts, as_json=as_json, shown=shown)


def show(args: argparse.Namespace, document: object, text: str) -> None:
    """Print what a command has found: as JSON if the user wants that, else as text."""
    if args.json:
        print_json(document)
    else:
        print(text)


class _ShownTree(Protocol):
    def latest_common_time(self, a: str, b: str) -> int | None: ...


def is_static(tree: _ShownTree, stamp_ns: int, a: str, b: str) -> bool:
    """Return whether an answer about two frames holds at all times.

    Such an answer has the stamp 0. So may a sample, so the tree is asked about that stamp.
    """
    if stamp_ns:
        return False
    try:
        return tree.latest_common_time(a, b) is None
    except TransformException:
        return False


def show_answer(args: argparse.Namespace, tree: _ShownTree, answer: StampedTransform) -> None:
    """Print the result of a lookup in `tree` at once."""
    static = not args.json and is_static(
        tree, answer.stamp_ns, answer.parent_frame, answer.child_frame
    )
    show(args, answer_document(answer), answer_text(answer, static=static))
    sys.stdout.flush()


def is_unicode(stream: TextIO) -> bool:
    """Return whether a stream's encoding has all characters."""
    return (stream.encoding or "ascii").lower().startswith("utf")


def paint(part: str, text: str) -> str:
    """Return ``text`` in the terminal colour of a part of the output.

    There are no colours if stdout is not a terminal or the environment has ``NO_COLOR``. The
    branches of a tree are drawn in ASCII if stdout's encoding is not a Unicode one.
    """
    if part == "branch" and not is_unicode(sys.stdout):
        text = text.translate(_ASCII_BRANCHES)
    colour = _COLOURS.get(part)
    return f"\x1b[{colour}m{text}\x1b[0m" if colour and text and _coloured() else text


@functools.cache
def _coloured() -> bool:
    environment = os.environ
    plain = environment.get("NO_COLOR") or environment.get("TERM") == "dumb"
    return sys.stdout.isatty() and not plain


def row(label: str, value: str) -> str:
    """Return one line of a list of facts."""
    return f"  {label:<12} {value}".rstrip()


def when(stamp_ns: int) -> str:
    """Return a stamp in seconds, and its distance from now if it is of this machine's clock."""
    text = f"{seconds(stamp_ns)} s"
    age_ns = time.time_ns() - stamp_ns
    if abs(age_ns) <= CLOCK_RANGE_S * 10**9:
        text += f"  (in {age(-age_ns)})" if age_ns < 0 else f"  ({age(age_ns)} ago)"
    return text


#: The arguments of `table`.
Table = tuple[Sequence[str], Sequence[Sequence[str]], Sequence[int]]


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    texts: Sequence[int],
    parts: Sequence[str] = (),
) -> list[str]:
    """The lines of a table, with these columns to the left and all others to the right.

    `parts`: the part of the output that each row is, for its colour (`paint`).
    """
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = []
    for number, cells in enumerate([header, *rows]):
        line = "  ".join(
            cell.ljust(width) if column in texts else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ).rstrip()
        lines.append(paint(["header", *(parts or [""] * len(rows))][number], line))
    return lines


def figure(value: float | None, digits: int) -> str:
    """A number for a table; a dash for none."""
    return "-" if value is None else f"{value:.{digits}f}"


def announce(args: argparse.Namespace, showing: str, scheme: str, port: int) -> None:
    """Print the address of what a command shows until it is interrupted."""
    host = f"[{args.host}]" if ":" in args.host else args.host
    url = f"{scheme}://{host}:{port}"
    text = f"showing {showing} at {url} (Ctrl-C ends it)"
    show(args, {"url": url, "showing": showing}, text)
    sys.stdout.flush()


def numbers(labels: Sequence[str], values: Sequence[float], digits: int = 6) -> str:
    """Return numbers in a row, each after its label."""
    return "  ".join(
        # + 0.0 turns a rounded -0 into 0.
        f"{label} {round(value, digits) + 0.0:{digits + 4}.{digits}f}"
        for label, value in zip(labels, values, strict=True)
    )


def answer_document(answer: StampedTransform) -> dict[str, object]:
    """Return a lookup's result as JSON values: metres, quaternion (x, y, z, w), nanoseconds."""
    document: dict[str, object] = {
        "target": answer.parent_frame,
        "source": answer.child_frame,
        "stamp_ns": answer.stamp_ns,
        "translation": answer.transform.translation.tolist(),
        "rotation": answer.transform.rotation.tolist(),
    }
    if isinstance(answer, LatestTransform):
        document["newest_stamp_ns"] = answer.newest_stamp_ns
    if answer.gap_ns:
        document["gap_ns"] = answer.gap_ns
    return document


def answer_text(answer: StampedTransform, *, static: bool = False) -> str:
    """Return a lookup's result as text. `static`: it holds at all times."""
    source, target = printable(answer.child_frame), printable(answer.parent_frame)
    lines = [f"{paint('frame', source)} in {paint('frame', target)}"]
    if static:
        lines.append(row("time", "static"))
    elif isinstance(answer, LatestTransform):
        lines.append(row("newest link", when(answer.newest_stamp_ns)))
        lines.append(row("oldest link", when(answer.stamp_ns)))
    else:
        lines.append(row("time", when(answer.stamp_ns)))
    if answer.gap_ns:
        lines.append(row("gap", f"{age(answer.gap_ns)} without samples, interpolated"))
    rotation = answer.transform.rotation.tolist()
    degrees = [math.degrees(angle) for angle in answer.transform.rpy()]
    translation = answer.transform.translation.tolist()
    lines.append(row("translation", numbers("xyz", translation) + "  m"))
    lines.append(row("rotation", numbers("xyzw", rotation)))
    lines.append(row("", numbers(("roll", "pitch", "yaw"), degrees, digits=2) + "  deg"))
    return "\n".join(lines)


def velocity_document(velocity: Velocity) -> dict[str, object]:
    """Return a velocity as JSON values: metres and radians per second, nanoseconds."""
    return {
        "tracking": velocity.tracking_frame,
        "observation": velocity.observation_frame,
        "reference": velocity.reference_frame,
        "stamp_ns": velocity.stamp_ns,
        "start_ns": velocity.start_ns,
        "end_ns": velocity.end_ns,
        "linear": velocity.linear.tolist(),
        "angular": velocity.angular.tolist(),
    }


def velocity_text(velocity: Velocity, *, static: bool = False) -> str:
    """Return a velocity as text. `static`: it is the same at all times."""
    tracking, observation, reference = (
        paint("frame", printable(name))
        for name in (
            velocity.tracking_frame,
            velocity.observation_frame,
            velocity.reference_frame,
        )
    )
    angular = velocity.angular.tolist()
    degrees = [math.degrees(rate) for rate in angular]
    return "\n".join(
        [
            f"{tracking} as seen from {observation}, in the axes of {reference}",
            row("time", "static" if static else when(velocity.stamp_ns)),
            row("averaged", f"over {age(velocity.end_ns - velocity.start_ns)}"),
            row("linear", numbers("xyz", velocity.linear.tolist()) + "  m/s"),
            row("angular", numbers("xyz", angular) + "  rad/s"),
            row("", numbers("xyz", degrees, digits=2) + "  deg/s"),
        ]
    )
