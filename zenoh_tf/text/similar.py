"""Which of the names that exist was probably meant by one that does not."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from zenoh_tf._core import did_you_mean as _did_you_mean

__all__ = ["did_you_mean", "spelling"]


def spelling(name: str) -> str:
    """Return a name without what people confuse: case and slashes."""
    return name.replace("/", "").casefold()


def did_you_mean(unknown: str | Sequence[str], names: Collection[str]) -> str | None:
    """Return a question such as ``did you mean 'base_link'?``; None if no name is like it.

    First come names that differ in case or slashes, then those that differ by a prefix, as
    ``robot1/base_link`` does from ``base_link``, then those that differ by some letters.
    Of several unknown names, the question says which it is about:
    ``did you mean 'base_link' instead of 'base', and 'laser' instead of 'lase'?``
    """
    several = [unknown] if isinstance(unknown, str) else [*unknown]
    return _did_you_mean(several, [*names]) or None
