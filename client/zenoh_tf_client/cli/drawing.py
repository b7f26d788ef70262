"""The tree of frames as lines of text."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from zenoh_tf_client.cli import stamps
from zenoh_tf_client.cli.output import Palette


@dataclass(frozen=True)
class Link:
    """A frame and what is known of the link to its parent (``None``: it is a root)."""

    frame: str
    parent: str | None
    static: bool
    newest_stamp_ns: int | None
    rate_hz: float | None
    authority: str


def draw(links: Iterable[Link], now_ns: int, colour: Palette) -> list[str]:
    """Lines of text, one for each frame: the tree, then columns for age, rate and authority.

    ``now_ns``: what ages are counted from.
    """
    by_name = {link.frame: link for link in links}
    children: dict[str | None, list[Link]] = {}
    for link in sorted(by_name.values(), key=lambda link: link.frame):
        # A parent that is not in the list any more would hide its whole branch.
        parent = link.parent if link.parent in by_name else None
        children.setdefault(parent, []).append(link)

    rows: list[tuple[str, Link]] = []
    # Not recursive: a chain of a thousand links is a legal tree.
    todo = [("", "", root) for root in reversed(children.get(None, []))]
    while todo:
        prefix, branch, link = todo.pop()
        rows.append((prefix + branch, link))
        under = prefix + {"": "", "├─ ": "│  ", "└─ ": "   "}[branch]
        last = "└─ "
        for child in reversed(children.get(link.frame, [])):
            todo.append((under, last, child))
            last = "├─ "

    width = max((len(lead) + len(link.frame) for lead, link in rows), default=0)
    owners = max((len(link.authority) for _, link in rows), default=0)
    return [_line(lead, link, now_ns, width, owners, colour).rstrip() for lead, link in rows]


def _line(lead: str, link: Link, now_ns: int, width: int, owners: int, colour: Palette) -> str:
    padding = " " * (width - len(lead) - len(link.frame))
    name = colour.strong(link.frame) if link.parent is None else link.frame
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
