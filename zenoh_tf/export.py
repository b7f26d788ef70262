"""The whole tree as text, Graphviz DOT or Mermaid, from a list of ``FrameInfo``.

    print(export.text([tree.frame(name) for name in tree.frames()]))

All three formats show the same for every link: authority, rate, newest stamp and its delay,
buffer (the time from the oldest to the newest sample), number of samples, and the counters that
are not zero. ``FrameInfo`` explains the counters; ``conflicts`` is its ``authority_changes``. A
static link holds at all times, so it is marked static and has neither rate nor times.

The delay is ``now_ns`` (default: this machine's clock) minus the newest stamp, negative if that
lies ahead. If the two are more than a day apart, the stamps are of another clock, such as a
simulator's or a recording's, and there is no delay.

Control characters in names are escaped, such as ``\\n``. A parent that is not in the list is
drawn without figures. An empty list gives "no frames".
"""

from __future__ import annotations

import re
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence

from zenoh_tf.introspection.frame_info import FrameInfo
from zenoh_tf.text import printable
from zenoh_tf.text.times import CLOCK_RANGE_S, milliseconds

__all__ = ["dot", "mermaid", "printable", "text"]

#: From this delay on, a link is painted as late.
_LATE_S = 2.0

_EMPTY = "no frames"

#: Field of FrameInfo -> name in the output.
_COUNTERS = {
    "rewritten": "rewritten",
    "dropped": "dropped",
    "evicted": "evicted",
    "authority_changes": "conflicts",
    "reparented": "reparented",
    "switched": "switched",
}

_COLUMNS = ("rate [Hz]", "delay [s]", "newest [s]", "buffer [s]", "samples", "authority", "counted")

# Mermaid interprets quotes, comments, Markdown, icons, formulae and entities inside a label. So
# only words and the separators between their letters stay unescaped.
_NOT_PLAIN = re.compile(r"(?<!\w)[ _./-]|[ _./-](?!\w)|[^\w ./-]")


def text(
    frames: Iterable[FrameInfo],
    now_ns: int | None = None,
    *,
    paint: Callable[[str, str], str] = lambda part, text: text,
) -> str:
    """Return one line per frame, children below their parent, with the figures in columns.

    Args:
        frames: The frames to show.
        now_ns: The time to compare stamps with, nanoseconds; None means this machine's clock.
        paint: Called with the kind of a part (``header``, ``branch``, ``frame``, ``static``,
            ``fresh`` or ``late`` figures, ``authority``, ``counted``) and its text. Returns the
            text to print instead, which must be as wide on the screen.
    """
    now_ns = _now_ns(now_ns)
    walk = [*_walk(frames)]
    if not walk:
        return _EMPTY
    table = [_COLUMNS, *(_cells(link, now_ns) for _, link in walk)]
    widths = [max(map(_width, column)) for column in zip(*table, strict=True)]
    margin = max(_width(branch + printable(link.name)) for branch, link in walk)

    def figures(cells: Sequence[str]) -> tuple[str, str, str]:
        """Pad the cells: numbers to the right, the authority and the counters to the left."""
        pads = [" " * (width - _width(cell)) for width, cell in zip(widths, cells, strict=True)]
        *numbers, authority, counted = cells
        return (
            "".join(f"  {pad}{cell}" for pad, cell in zip(pads, numbers, strict=False)),
            f"  {authority}",
            f"{pads[-2]}  {counted}" if counted else "",
        )

    lines = [paint("header", " " * margin + "".join(figures(_COLUMNS)))]
    for (branch, link), cells in zip(walk, table[1:], strict=True):
        name = printable(link.name)
        line = paint("branch", branch) + paint("frame", name)
        if link.parent is not None:
            numbers, authority, counted = figures(cells)
            line += " " * (margin - _width(branch + name)) + paint(_part(link, now_ns), numbers)
            line += paint("authority", authority) + paint("counted", counted)
        lines.append(line.rstrip())
    return "\n".join(lines)


def dot(frames: Iterable[FrameInfo], now_ns: int | None = None) -> str:
    """Return a Graphviz digraph; edges point from parent to child, static ones are dashed.

    Args:
        frames: The frames to show.
        now_ns: The time to compare stamps with, nanoseconds; None means this machine's clock.
    """
    lines = [
        "digraph frames {",
        '    node [shape=box, style=rounded, fontname="Helvetica"];',
        '    edge [fontname="Helvetica", fontsize=10];',
    ]
    nodes, edges = _graph(frames)
    for number, name in enumerate(nodes):
        lines.append(f"    n{number} [label={_dot_label([name])}];")
    now_ns = _now_ns(now_ns)
    for parent, child, link in edges:
        style = ", style=dashed" if link.static else ""
        label = _dot_label(_sentences(link, now_ns))
        lines.append(f"    n{parent} -> n{child} [label={label}{style}];")
    if not nodes:
        lines.append(f"    empty [label={_dot_label([_EMPTY])}, shape=plaintext];")
    return "\n".join([*lines, "}"])


def mermaid(frames: Iterable[FrameInfo], now_ns: int | None = None) -> str:
    """Return a Mermaid flowchart; edges point from parent to child, static ones are dotted.

    Mermaid's defaults reject charts of more than 500 edges or 50,000 characters, which is a tree of
    some 300 frames. Use Graphviz for larger ones.

    Args:
        frames: The frames to show.
        now_ns: The time to compare stamps with, nanoseconds; None means this machine's clock.
    """
    lines = ["flowchart TD"]
    nodes, edges = _graph(frames)
    for number, name in enumerate(nodes):
        lines.append(f"    n{number}({_mermaid_label([name])})")
    now_ns = _now_ns(now_ns)
    for parent, child, link in edges:
        arrow = "-.->" if link.static else "-->"
        label = _mermaid_label(_sentences(link, now_ns))
        lines.append(f"    n{parent} {arrow}|{label}| n{child}")
    if not nodes:
        lines.append(f"    empty({_mermaid_label([_EMPTY])})")
    return "\n".join(lines)


def _walk(frames: Iterable[FrameInfo]) -> Iterator[tuple[str, FrameInfo]]:
    """Yield every frame once, parents first, sorted by name, with the branch drawn before it."""
    by_name = {link.name: link for link in sorted(frames, key=lambda link: link.name)}
    children: dict[str | None, list[FrameInfo]] = {}
    for link in by_name.values():
        children.setdefault(link.parent, []).append(link)
    roots = [link for link in by_name.values() if link.parent not in by_name]
    # Frames that no root leads to form a loop, if the list was gathered while the tree changed.
    for start in [*roots, *by_name.values()]:
        # A chain may have a thousand links, so this must not recurse.
        todo = [("", "", start)]
        while todo:
            prefix, branch, link = todo.pop()
            if by_name.pop(link.name, None) is None:
                continue
            yield prefix + branch, link
            under = prefix + {"": "", "├─ ": "│  ", "└─ ": "   "}[branch]
            last = "└─ "
            for child in reversed(children.get(link.name, [])):
                todo.append((under, last, child))
                last = "├─ "


def _graph(frames: Iterable[FrameInfo]) -> tuple[list[str], list[tuple[int, int, FrameInfo]]]:
    """Return the names, and the links as (index of parent's name, of child's name, link)."""
    links = [link for _, link in _walk(frames)]
    rows: dict[str, int] = {}
    for link in links:
        for name in (link.parent, link.name):
            if name is not None:
                rows.setdefault(name, len(rows))
    edges = [
        (rows[link.parent], rows[link.name], link) for link in links if link.parent is not None
    ]
    return [*rows], edges


def _cells(link: FrameInfo, now_ns: int) -> tuple[str, ...]:
    """Return the cells of a link's columns, empty for a root."""
    if link.parent is None:
        return ("",) * len(_COLUMNS)
    tail = (str(link.samples), printable(link.authority), ", ".join(_counted(link)))
    if link.static or link.newest_stamp_ns is None or link.oldest_stamp_ns is None:
        return ("static" if link.static else "", "", "", "", *tail)
    delay_s = _delay_s(link, now_ns)
    return (
        "" if link.rate_hz is None else f"{link.rate_hz:.1f}",
        "" if delay_s is None else f"{delay_s:.3f}",
        milliseconds(link.newest_stamp_ns),
        milliseconds(link.newest_stamp_ns - link.oldest_stamp_ns),
        *tail,
    )


def _sentences(link: FrameInfo, now_ns: int) -> list[str]:
    """Return the same as the lines of a label."""
    rate, delay, newest, buffer, samples, authority, _ = _cells(link, now_ns)
    if link.static:
        figures = ["static"]
    else:
        figures = [
            f"rate {rate} Hz" if rate else "",
            f"delay {delay} s" if delay else "",
            f"newest {newest} s" if newest else "",
            f"buffer {buffer} s" if buffer else "",
            f"samples {samples}",
        ]
    return [line for line in [authority, *figures, *_counted(link)] if line]


def _part(link: FrameInfo, now_ns: int) -> str:
    if link.static:
        return "static"
    delay_s = _delay_s(link, now_ns)
    return "fresh" if delay_s is None or delay_s < _LATE_S else "late"


def _counted(link: FrameInfo) -> list[str]:
    counts = ((getattr(link, field), name) for field, name in _COUNTERS.items())
    return [f"{name} {count}" for count, name in counts if count]


def _delay_s(link: FrameInfo, now_ns: int) -> float | None:
    delay_s = link.delay_s(now_ns)
    return None if delay_s is None or abs(delay_s) > CLOCK_RANGE_S else delay_s


def _now_ns(now_ns: int | None) -> int:
    return time.time_ns() if now_ns is None else now_ns


def _width(text: str) -> int:
    """Return the columns that a terminal needs."""
    return sum(
        0 if unicodedata.combining(char) else 1 + (unicodedata.east_asian_width(char) in "WF")
        for char in text
    )


def _dot_label(lines: Iterable[str]) -> str:
    # Graphviz also interprets HTML entities in a label.
    escapes = str.maketrans({"\\": "\\\\", '"': '\\"', "&": "&amp;"})
    return '"' + "\\n".join(printable(line).translate(escapes) for line in lines) + '"'


def _mermaid_label(lines: Iterable[str]) -> str:
    # Mermaid's entities are decimal, without HTML's ampersand.
    return '"' + "<br/>".join(_NOT_PLAIN.sub(_entity, printable(line)) for line in lines) + '"'


def _entity(match: re.Match[str]) -> str:
    return f"#{ord(match[0])};"
