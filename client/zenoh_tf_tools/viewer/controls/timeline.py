"""A recording's time line, as HTML: the time shown, and when frames with faults had samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from zenoh_tf_tools.viewer.controls.figures import PURPLE, block, name_html

#: Most frames with a line; more are counted.
_LINES: Final = 6
#: Most parts of a line: of one with more pauses the rest is one part.
_PARTS: Final = 50

Spans = Sequence[tuple[int, int]]


def timeline_html(range_ns: tuple[int, int], time_ns: int, faulty: Mapping[str, Spans]) -> str:
    """Return a line for each frame that has a fault: purple where it has samples.

    Args:
        range_ns: The first and last time, nanoseconds.
        time_ns: The time that is shown.
        faulty: The frames that have a fault, and between which times they have samples.
    """
    if not faulty:
        return ""
    cursor = f"<i style='{_at(range_ns, time_ns, time_ns)};top:0;bottom:0;background:#228be6'></i>"
    lines = "".join(
        f"<div>{name_html(name)}</div><div style='position:relative;height:5px;background:#ddd'>"
        + "".join(
            f"<i style='{_at(range_ns, *part)};height:5px;background:{PURPLE}'></i>"
            for part in _parts(spans)
        )
        + "</div>"
        for name, spans in [*faulty.items()][:_LINES]
    )
    more = f"<div>and {len(faulty) - _LINES:,} more</div>" if len(faulty) > _LINES else ""
    return block(f"<div style='position:relative'>{lines}{more}{cursor}</div>")


def _parts(spans: Spans) -> Spans:
    return (
        [*spans[: _PARTS - 1], (spans[_PARTS - 1][0], spans[-1][1])]
        if len(spans) > _PARTS
        else spans
    )


def _at(range_ns: tuple[int, int], first_ns: int, last_ns: int) -> str:
    """Where a part of the line is, at least two pixels wide."""
    length_ns = max(1, range_ns[1] - range_ns[0])
    left, right = (min(max(0.0, (x - range_ns[0]) / length_ns), 1.0) for x in (first_ns, last_ns))
    return f"position:absolute;left:{left:.2%};width:max(2px,{right - left:.2%})"
