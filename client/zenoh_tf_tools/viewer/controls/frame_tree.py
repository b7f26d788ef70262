"""The tree of frames beside the scene: which rows it has, and which frames are hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from zenoh_tf.introspection.explain import path_to_root
from zenoh_tf_tools.viewer.source import ViewedLink


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the list.

    Attributes:
        name: The frame.
        depth: How many ancestors it has.
        found: Whether it was searched for; else it is an ancestor of one that was.
    """

    name: str
    depth: int
    found: bool


def rows(links: Mapping[str, ViewedLink], search: str = "") -> list[Row]:
    """Return the frames, each before its children, and these by name.

    Args:
        links: The links by name; a link whose parent is not among them is a root.
        search: If it is not empty, only the frames whose name has this text in it, in upper or
            lower case, and their ancestors.
    """
    text = search.casefold()
    matching = {name for name in links if text in name.casefold()}
    wanted = {link.name for name in matching for link in path_to_root(name, links)}
    children: dict[str | None, list[str]] = {}
    for name in sorted(wanted, reverse=True):
        parent = links[name].parent
        children.setdefault(parent if parent in links else None, []).append(name)
    found = []
    stack = [(name, 0) for name in children.get(None, ())]
    while stack:
        name, depth = stack.pop()
        found.append(Row(name, depth, name in matching))
        stack += [(child, depth + 1) for child in children.get(name, ())]
    return found


def with_descendants(links: Mapping[str, ViewedLink], name: str) -> set[str]:
    """Return a frame and all that hang on it."""
    return {x for x in links if any(link.name == name for link in path_to_root(x, links))}


def page_of(listed: Sequence[Row], page: int, size: int) -> tuple[int, Sequence[Row]]:
    """Return the number of the page that is shown, at most the last one, and its rows."""
    page = max(0, min(page, (len(listed) - 1) // size))
    return page, listed[page * size : (page + 1) * size]
