"""What commands print: JSON documents, facts in rows, poses and colours."""

from __future__ import annotations

import functools
import json
import math
import os
import sys
import time
from collections.abc import Sequence

from zenoh_tf import LatestTransform, StampedTransform, Velocity
from zenoh_tf.export import printable
from zenoh_tf_client.cli import stamps

#: Terminal colours: bold, faint, green, yellow, cyan; other parts have none.
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


def print_json(document: object) -> None:
    """One JSON document on one line, as pipes like it."""
    print(json.dumps(document, ensure_ascii=False, allow_nan=False))


def paint(part: str, text: str) -> str:
    """``text`` in the terminal colour of a part; in none where stdout is no terminal or the
    environment has ``NO_COLOR``."""
    colour = _COLOURS.get(part)
    return f"\x1b[{colour}m{text}\x1b[0m" if colour and text and _coloured() else text


@functools.cache
def _coloured() -> bool:
    environment = os.environ
    plain = environment.get("NO_COLOR") or environment.get("TERM") == "dumb"
    return sys.stdout.isatty() and not plain


def row(label: str, value: str) -> str:
    """A fact, as one of several below each other."""
    return f"  {label:<12} {value}".rstrip()


def when(stamp_ns: int) -> str:
    """A stamp in seconds, and how long ago it was where the clock can tell."""
    text = f"{stamps.seconds(stamp_ns)} s"
    if stamps.is_clock_time(stamp_ns):
        text += f"  ({stamps.age(time.time_ns() - stamp_ns)} ago)"
    return text


def numbers(labels: Sequence[str], values: Sequence[float], digits: int = 6) -> str:
    """Numbers in a row, each behind its label."""
    return "  ".join(
        # + 0.0 turns a rounded -0 into 0.
        f"{label} {round(value, digits) + 0.0:{digits + 4}.{digits}f}"
        for label, value in zip(labels, values, strict=True)
    )


def answer_document(answer: StampedTransform) -> dict[str, object]:
    """A lookup's answer as JSON values: metres, quaternion ``(x, y, z, w)``, nanoseconds."""
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
    """A lookup's answer for reading."""
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
    """A velocity as JSON values: metres and radians per second, nanoseconds."""
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
    """A velocity for reading."""
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
            row("averaged", f"over {stamps.age(velocity.end_ns - velocity.start_ns)}"),
            row("linear", numbers("xyz", velocity.linear.tolist()) + "  m/s"),
            row("angular", numbers("xyz", angular) + "  rad/s"),
            row("", numbers("xyz", degrees, digits=2) + "  deg/s"),
        ]
    )


def roll_pitch_yaw(rotation: Sequence[float]) -> tuple[float, float, float]:
    """Angles in radians about the fixed axes x, y, z, in this order, of a unit quaternion."""
    x, y, z, w = rotation
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw
