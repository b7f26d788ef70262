"""The tree of frames as lines of text."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from zenoh_tf import FrameInfo
from zenoh_tf_client.cli import stamps
from zenoh_tf_client.cli.output import Palette, printable

#: Older links are drawn in the colour of warnings.
FRESH_NS = 2_000_000_000


def draw(frames: Iterable[FrameInfo], now_ns: int, colour: Palette) -> list[str]:
    """Lines of text, one for each frame: the tree, then columns for age, rate and authority.

    ``now_ns``: what ages are counted from.
    """
    by_name = {link.name: link for link in frames}
    children: dict[str | None, list[FrameInfo]] = {}
    for link in sorted(by_name.values(), key=lambda link: link.name):
        # A parent that is not in the list any more would hide its whole branch.
        parent = link.parent if link.parent in by_name else None
        children.setdefault(parent, []).append(link)

    rows: list[tuple[str, FrameInfo]] = []
    # Not recursive: a chain of a thousand links is a legal tree.
    todo = [("", "", root) for root in reversed(children.get(None, []))]
    while todo:
        prefix, branch, link = todo.pop()
        rows.append((prefix + branch, link))
        under = prefix + {"": "", "├─ ": "│  ", "└─ ": "   "}[branch]
        last = "└─ "
        for child in reversed(children.get(link.name, [])):
            todo.append((under, last, child))
            last = "├─ "

    lines = []
    names = _width(lead + printable(link.name) for lead, link in rows)
    ages = _width(_age(link, now_ns) for _, link in rows)
    rates = _width(_rate(link) for _, link in rows)
    for lead, link in rows:
        name = printable(link.name)
        if link.parent is None:
            lines.append(colour.faint(lead) + colour.strong(name))
            continue
        age = _tint(link, now_ns, colour)(_age(link, now_ns).rjust(ages))
        owner = colour.faint(printable(link.authority))
        cells = [name.ljust(names - len(lead)), age, _rate(link).rjust(rates), owner]
        lines.append(colour.faint(lead) + "  ".join(cells).rstrip())
    return lines


def _width(texts: Iterable[str]) -> int:
    return max(map(len, texts), default=0)


def _age(link: FrameInfo, now_ns: int) -> str:
    if link.parent is None:
        return ""
    if link.static:
        return "static"
    if link.newest_stamp_ns is None:
        return "-"
    age_ns = now_ns - link.newest_stamp_ns
    if abs(age_ns) < stamps.CLOCK_RANGE_NS:
        return stamps.age(age_ns)
    # A link of recorded time in a tree of the clock's.
    return f"at {link.newest_stamp_ns / 1e9:.0f} s"


def _rate(link: FrameInfo) -> str:
    return "" if link.rate_hz is None else f"{link.rate_hz:.1f} Hz"


def _tint(link: FrameInfo, now_ns: int, colour: Palette) -> Callable[[str], str]:
    if link.static:
        return colour.accent
    fresh = link.newest_stamp_ns is not None and now_ns - link.newest_stamp_ns < FRESH_NS
    return colour.good if fresh else colour.warn
