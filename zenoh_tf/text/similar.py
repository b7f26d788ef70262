"""Which of the names that exist was probably meant by one that does not."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from zenoh_tf._core import did_you_mean as _did_you_mean
from zenoh_tf._core import similar_names

__all__ = ["did_you_mean", "similar", "spelling"]


def spelling(name: str) -> str:
    """Return a name without what people confuse: case and slashes."""
    return name.replace("/", "").casefold()


def similar(name: str, names: Collection[str], most: int = 3) -> list[str]:
    """Return at most `most` names that are most like one that does not exist, best first.

    First come names that differ in case or slashes, then those that differ by a prefix, as
    ``robot1/base_link`` does from ``base_link``, then those that differ by some letters.
    """
    return similar_names(name, [*names], most)


def did_you_mean(unknown: str | Sequence[str], names: Collection[str]) -> str | None:
    """Return a question such as ``did you mean 'base_link'?``; None if no name is like it.

    Of several unknown names, the question says which it is about:
    ``did you mean 'base_link' instead of 'base', and 'laser' instead of 'lase'?``
    """
    several = [unknown] if isinstance(unknown, str) else [*unknown]
    return _did_you_mean(several, [*names]) or None
