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
    """How one link differs from before to after."""

    child: str
    kind: Kind
    before: StampedTransform | None
    after: StampedTransform | None

    @property
    def offset_mm(self) -> tuple[float, float, float] | None:
        """How far the child has moved along the parent's axes; None unless it has one parent."""
        if self.before is None or self.after is None or self.kind == "reparented":
            return None
        x, y, z = (
            1000 * (after - before)
            for before, after in zip(
                self.before.transform.translation.tolist(),
                self.after.transform.translation.tolist(),
                strict=True,
            )
        )
        return x, y, z

    @property
    def translation_mm(self) -> float | None:
        """The length of the offset."""
        return None if self.offset_mm is None else math.hypot(*self.offset_mm)

    @property
    def rotation_deg(self) -> float | None:
        """The angle between the two rotations; None unless the child has one parent."""
        if self.before is None or self.after is None or self.kind == "reparented":
            return None
        return _angle_deg(self.before, self.after)

    def document(self) -> dict[str, object]:
        """As JSON values."""
        return {
            "child": self.child,
            "kind": self.kind,
            "parent_before": None if self.before is None else self.before.parent_frame,
            "parent_after": None if self.after is None else self.after.parent_frame,
            "translation_mm": self.translation_mm,
            "offset_mm": None if self.offset_mm is None else list(self.offset_mm),
            "rotation_deg": self.rotation_deg,
        }


def compare(before: Links, after: Links) -> list[Difference]:
    """The difference of each link, by child frame; also of links that are the same."""
    return [
        Difference(
            child, _kind(before.get(child), after.get(child)), before.get(child), after.get(child)
        )
        for child in sorted(before.keys() | after.keys())
    ]


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


def _kind(before: StampedTransform | None, after: StampedTransform | None) -> Kind:
    if before is None:
        return "added"
    if after is None:
        return "removed"
    if before.parent_frame != after.parent_frame:
        return "reparented"
    distance_mm = 1000 * math.dist(before.transform.translation, after.transform.translation)
    is_same = distance_mm < _SAME_MM and _angle_deg(before, after) < _SAME_DEG
    return "same" if is_same else "moved"


def _angle_deg(before: StampedTransform, after: StampedTransform) -> float:
    x, y, z, w = (before.transform.inverse() @ after.transform).rotation.tolist()
    return math.degrees(2 * math.atan2(math.hypot(x, y, z), abs(w)))
