"""The tree of frames as lines of text."""

from __future__ import annotations

from collections.abc import Iterable

from zenoh_tf import FrameInfo
from zenoh_tf_client.cli import stamps
from zenoh_tf_client.cli.output import Palette


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

    width = max((len(lead) + len(link.name) for lead, link in rows), default=0)
    owners = max((len(link.authority) for _, link in rows), default=0)
    return [_line(lead, link, now_ns, width, owners, colour).rstrip() for lead, link in rows]


def _line(lead: str, link: FrameInfo, now_ns: int, width: int, owners: int, colour: Palette) -> str:
    padding = " " * (width - len(lead) - len(link.name))
    name = colour.strong(link.name) if link.parent is None else link.name
    tree = colour.faint(lead) + name + padding
    if link.parent is None:
        return tree
    authority = colour.faint(f"{link.authority:<{owners}}")
    if link.static:
        return f"{tree}  {colour.accent('static'.rjust(8))}  {'':>9}  {authority}"
    age_ns = None if link.newest_stamp_ns is None else now_ns - link.newest_stamp_ns
    if age_ns is None:
        age = "-"
    elif abs(age_ns) < stamps.CLOCK_RANGE_NS:
        age = stamps.age(age_ns)
    else:  # a link of recorded time in a tree of the clock's
        age = f"at {(now_ns - age_ns) / 1e9:.0f} s"
    age = age.rjust(8)
    fresh = age_ns is not None and age_ns < 2_000_000_000
    rate = "" if link.rate_hz is None else f"{link.rate_hz:.1f} Hz"
    return f"{tree}  {colour.good(age) if fresh else colour.warn(age)}  {rate:>9}  {authority}"
