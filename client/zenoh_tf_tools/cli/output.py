"""What commands print: JSON documents, lists of facts, poses and colours."""

from __future__ import annotations

import functools
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from typing import TextIO

from zenoh_tf import LatestTransform, StampedTransform, TransformException, Velocity
from zenoh_tf.text import printable
from zenoh_tf.text.times import CLOCK_RANGE_S, age, seconds

#: Terminal colours: bold, faint, green, yellow, cyan; parts that are not listed have none.
_COLOURS = {
    "frame": "1",
    "branch": "2",
    "header": "2",
    "authority": "2",
    "fresh": "32",
    "late": "33",
    "counted": "33",
    "static": "36",
}


#: The branches of `zenoh_tf.export.text`, as wide in ASCII.
_ASCII_BRANCHES = str.maketrans("│├└─", "||`-")


def print_json(document: object, file: TextIO | None = None) -> None:
    """Print one JSON document on one line, to ``file`` or stdout."""
    stream = file or sys.stdout
    # Only escapes are sure to be valid JSON in an encoding that lacks a character.
    print(json.dumps(document, ensure_ascii=not is_unicode(stream), allow_nan=False), file=stream)


def report_waiting(error: TransformException, as_json: bool) -> None:
    """Print on stderr why a command that goes on has nothing to show."""
    name, message = type(error).__name__, str(error)
    if as_json:
        document = {"type": name, "message": message, "fields": error.facts}
        print_json(document, file=sys.stderr)
    else:
        line = " ".join(f"{name}: {message}".split())
        print(f"zenoh-tf: {printable(line)} (waiting)", file=sys.stderr, flush=True)


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


def url(scheme: str, host: str, port: int) -> str:
    """Return an address to open."""
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"


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
    return document


def answer_text(answer: StampedTransform) -> str:
    """Return a lookup's result as text."""
    source, target = printable(answer.child_frame), printable(answer.parent_frame)
    lines = [f"{paint('frame', source)} in {paint('frame', target)}"]
    if isinstance(answer, LatestTransform):
        lines.append(row("newest link", when(answer.newest_stamp_ns)))
        lines.append(row("oldest link", when(answer.stamp_ns)))
    else:
        lines.append(row("time", when(answer.stamp_ns)))
    rotation = answer.transform.rotation.tolist()
    degrees = [math.degrees(angle) for angle in roll_pitch_yaw(rotation)]
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


def velocity_text(velocity: Velocity) -> str:
    """Return a velocity as text."""
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
            row("time", when(velocity.stamp_ns)),
            row("averaged", f"over {age(velocity.end_ns - velocity.start_ns)}"),
            row("linear", numbers("xyz", velocity.linear.tolist()) + "  m/s"),
            row("angular", numbers("xyz", angular) + "  rad/s"),
            row("", numbers("xyz", degrees, digits=2) + "  deg/s"),
        ]
    )


def roll_pitch_yaw(rotation: Sequence[float]) -> tuple[float, float, float]:
    """Return the angles in radians about the fixed axes x, y, z, in this order.

    Requires a unit quaternion (x, y, z, w).
    """
    x, y, z, w = rotation
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw
