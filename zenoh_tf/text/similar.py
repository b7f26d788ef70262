"""Which of the names that exist was probably meant by one that does not."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence

from zenoh_tf.text import quoted

__all__ = ["did_you_mean", "similar", "spelling"]

#: Names that are compared letter by letter, at a cost of some 10 us each.
_MAX_COMPARED = 20_000


def spelling(name: str) -> str:
    """Return a name without what people confuse: case and slashes."""
    return name.replace("/", "").casefold()


def similar(name: str, names: Collection[str], most: int = 3) -> list[str]:
    """Return at most `most` names that are most like one that does not exist, best first.

    First come names that differ in case or slashes, then those that differ by a prefix, as
    ``robot1/base_link`` does from ``base_link``, then those that differ by some letters.
    """
    found: dict[str, None] = {}  # a set that keeps the order
    wanted, last = spelling(name), _last_part(name)
    others = sorted(other for other in names if other != name)
    found.update(dict.fromkeys(other for other in others if spelling(other) == wanted))
    end = name.rpartition("/")[2]
    exact_first = sorted(others, key=lambda other: other.rpartition("/")[2] != end)
    found.update(dict.fromkeys(other for other in exact_first if _last_part(other) == last))
    if len(found) < most:
        by_spelling: dict[str, str] = {}
        for other in others[:_MAX_COMPARED]:
            by_spelling.setdefault(spelling(other), other)
        close = difflib.get_close_matches(wanted, by_spelling, n=most, cutoff=0.6)
        found.update(dict.fromkeys(by_spelling[key] for key in close))
    return [*found][:most]


def did_you_mean(unknown: str | Sequence[str], names: Collection[str]) -> str | None:
    """Return a question such as ``did you mean 'base_link'?``; None if no name is like it.

    Of several unknown names, the question says which it is about:
    ``did you mean 'base_link' instead of 'base', and 'laser' instead of 'lase'?``
    """
    several = [unknown] if isinstance(unknown, str) else unknown
    parts = []
    for name in several:
        found = [quoted(other) for other in similar(name, names)]
        if found:
            choice = " or ".join(filter(None, [", ".join(found[:-1]), found[-1]]))
            parts.append(choice if len(several) == 1 else f"{choice} instead of {quoted(name)}")
    return f"did you mean {', and '.join(parts)}?" if parts else None


def _last_part(name: str) -> str:
    return spelling(name.rstrip("/").rpartition("/")[2])
