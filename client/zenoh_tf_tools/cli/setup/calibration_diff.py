"""The difference of two sets of static links."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final, Literal

from zenoh_tf import StampedTransform
from zenoh_tf.text import printable
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.setup.calibration_files import Links

#: Smaller differences are rounding.
_SAME_MM: Final = 1e-6
_SAME_DEG: Final = 1e-6

Kind = Literal["added", "removed", "reparented", "moved", "same"]
_SIGNS: Final[dict[Kind, str]] = {"added": "+", "removed": "-", "reparented": ">", "moved": "~"}


@dataclass(frozen=True)
class Difference:
    """How one link differs from before to after.

    `offset_mm`, how far the child has moved along the parent's axes, and `rotation_deg`, the angle
    between the two rotations, are None unless the child has one parent.
    """

    child: str
    kind: Kind
    before: StampedTransform | None
    after: StampedTransform | None
    offset_mm: list[float] | None = None
    rotation_deg: float | None = None

    @property
    def translation_mm(self) -> float | None:
        """The length of the offset."""
        return None if self.offset_mm is None else math.hypot(*self.offset_mm)

    def document(self) -> dict[str, object]:
        """As JSON values."""
        return {
            "child": self.child,
            "kind": self.kind,
            "parent_before": None if self.before is None else self.before.parent_frame,
            "parent_after": None if self.after is None else self.after.parent_frame,
            "translation_mm": self.translation_mm,
            "offset_mm": self.offset_mm,
            "rotation_deg": self.rotation_deg,
        }


def compare(before: Links, after: Links) -> list[Difference]:
    """The difference of each link, by child frame; also of links that are the same."""
    children = sorted(before.keys() | after.keys())
    return [_difference(child, before.get(child), after.get(child)) for child in children]


def _difference(
    child: str, before: StampedTransform | None, after: StampedTransform | None
) -> Difference:
    if before is None:
        return Difference(child, "added", before, after)
    if after is None:
        return Difference(child, "removed", before, after)
    if before.parent_frame != after.parent_frame:
        return Difference(child, "reparented", before, after)
    offset_mm = (1000 * (after.transform.translation - before.transform.translation)).tolist()
    x, y, z, w = (before.transform.inverse() @ after.transform).rotation.tolist()
    angle_deg = math.degrees(2 * math.atan2(math.hypot(x, y, z), abs(w)))
    is_same = math.hypot(*offset_mm) < _SAME_MM and angle_deg < _SAME_DEG
    return Difference(child, "same" if is_same else "moved", before, after, offset_mm, angle_deg)


def text(differences: Collection[Difference], dynamic: Collection[str] = ()) -> str:
    """Differences as lines, without the links that are the same.

    `dynamic`: child frames that are dynamic before.
    """
    changed = [each for each in differences if each.kind != "same"]
    width = max((len(printable(each.child)) for each in changed), default=0)
    lines = [_line(each, width, each.child in dynamic) for each in changed]
    same = len(differences) - len(changed)
    lines.append(f"{same} {'link is' if same == 1 else 'links are'} the same")
    return "\n".join(lines)


def _line(difference: Difference, width: int, is_dynamic: bool) -> str:
    before, after = difference.before, difference.after
    name = output.paint("frame", printable(difference.child).ljust(width))
    start = f"{_SIGNS[difference.kind]} {name}  "
    if before is None:
        assert after is not None
        note = ", dynamic until now" if is_dynamic else ""
        return f"{start}new in {printable(after.parent_frame)}{note}"
    if after is None:
        return f"{start}only before, in {printable(before.parent_frame)}"
    if difference.kind == "reparented":
        return f"{start}from {printable(before.parent_frame)} to {printable(after.parent_frame)}"
    x, y, z = difference.offset_mm or (0, 0, 0)
    return (
        f"{start}{difference.translation_mm:10.3f} mm {difference.rotation_deg:9.4f} deg"
        f"   x {x + 0.0:+.3f}  y {y + 0.0:+.3f}  z {z + 0.0:+.3f} mm in "
        f"{printable(after.parent_frame)}"
    )
