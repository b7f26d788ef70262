"""What commands print: JSON documents, poses and colours."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Sequence
from typing import IO

from zenoh_tf import LatestTransform, StampedTransform
from zenoh_tf_client.cli import stamps


def print_json(document: object) -> None:
    """One JSON document on one line, as pipes like it."""
    print(json.dumps(document, ensure_ascii=False, allow_nan=False))


def printable(text: str) -> str:
    """``text`` with control characters escaped: frames are named by strangers, and a terminal
    obeys what it is sent."""
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode() for char in text
    )


class Palette:
    """Wraps text in terminal colours, or leaves it alone.

    Colours need a terminal on ``stream`` and no ``NO_COLOR`` in the environment.
    """

    def __init__(self, stream: IO[str] | None = None) -> None:
        stream = sys.stdout if stream is None else stream
        self._on = (
            stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
        )

    def _wrap(self, code: str, text: str) -> str:
        return f"\x1b[{code}m{text}\x1b[0m" if self._on and text else text

    def strong(self, text: str) -> str:
        return self._wrap("1", text)

    def faint(self, text: str) -> str:
        return self._wrap("2", text)

    def good(self, text: str) -> str:
        return self._wrap("32", text)

    def warn(self, text: str) -> str:
        return self._wrap("33", text)

    def accent(self, text: str) -> str:
        return self._wrap("36", text)


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
    colour = Palette()
    source, target = printable(answer.child_frame), printable(answer.parent_frame)
    lines = [f"{colour.strong(source)} in {colour.strong(target)}"]
    if isinstance(answer, LatestTransform):
        lines.append(_row("newest link", _when(answer.newest_stamp_ns)))
        lines.append(_row("oldest link", _when(answer.stamp_ns)))
    else:
        lines.append(_row("time", _when(answer.stamp_ns)))
    rotation = answer.transform.rotation.tolist()
    degrees = [math.degrees(angle) for angle in roll_pitch_yaw(rotation)]
    translation = answer.transform.translation.tolist()
    lines.append(_row("translation", _numbers("xyz", translation) + "  m"))
    lines.append(_row("rotation", _numbers("xyzw", rotation)))
    lines.append(_row("", _numbers(("roll", "pitch", "yaw"), degrees, digits=2) + "  deg"))
    return "\n".join(lines)


def roll_pitch_yaw(rotation: Sequence[float]) -> tuple[float, float, float]:
    """Angles in radians about the fixed axes x, y, z, in this order, of a unit quaternion."""
    x, y, z, w = rotation
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw


def _row(label: str, value: str) -> str:
    return f"  {label:<12} {value}"


def _numbers(labels: Sequence[str], values: Sequence[float], digits: int = 6) -> str:
    return "  ".join(
        # + 0.0 turns a rounded -0 into 0.
        f"{label} {round(value, digits) + 0.0:{digits + 4}.{digits}f}"
        for label, value in zip(labels, values, strict=True)
    )


def _when(stamp_ns: int) -> str:
    text = f"{stamps.seconds(stamp_ns)} s"
    if stamps.is_clock_time(stamp_ns):
        text += f"  ({stamps.age(time.time_ns() - stamp_ns)} ago)"
    return text
