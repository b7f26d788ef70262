"""Phrases that the evidence of several checks has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from zenoh_tf.text import quoted
from zenoh_tf_tools.doctor.facts import LinkFacts, TreeFacts

#: What a check yields: the subject, a frame or an authority, and the evidence as a sentence.
Evidence = Iterator[tuple[str, str]]

_SHOWN: Final = 5


def authority(name: str) -> str:
    """Return who wrote a link."""
    return quoted(name) if name else "a publisher without a name"


def by_publisher(link: LinkFacts, evidence: str) -> tuple[str, str]:
    """Return a link as the subject, and the evidence with who wrote the link."""
    return link.frame.name, f"{evidence}; it is by {authority(link.frame.authority)}"


def listed(names: list[str]) -> str:
    """Return the first of many names, and how many more there are."""
    more = f" and {len(names) - _SHOWN:,} more" if len(names) > _SHOWN else ""
    return ", ".join(map(quoted, names[:_SHOWN])) + more


def times(count: int) -> str:
    """Return how often something was."""
    return "once" if count == 1 else "twice" if count == 2 else f"{count:,} times"


def samples(count: int) -> str:
    """Return how many samples."""
    return "1 sample" if count == 1 else f"{count:,} samples"


def window(facts: TreeFacts, link: LinkFacts, counter: str) -> str:
    """Return the time in which a counter has grown, after a comma; empty without one."""
    if facts.is_complete or facts.grown(link, counter) is None:
        return ""
    return f" in {facts.observed_s:.1f} s"


def length(metres: float) -> str:
    """Return a length in a unit that suits it."""
    return f"{metres:,.1f} m" if metres >= 1 else f"{metres * 1e3:.1f} mm"


def shift(metres: float, radians: float) -> str:
    """Return a change of a pose: how far, and how many degrees if it turned."""
    turn = f"{radians * 57.29578:.1f} degrees" if radians > 1e-3 else ""
    return " and ".join(filter(None, [length(metres) if metres > 1e-6 else "", turn])) or "little"
