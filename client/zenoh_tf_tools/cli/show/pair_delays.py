"""How far lookups between two frames lag behind the clock, from the records of all frames."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from zenoh_tf import FrameInfo
from zenoh_tf.introspection.explain import path_to_root
from zenoh_tf.text import quoted
from zenoh_tf.text.times import CLOCK_RANGE_S

Pair = tuple[str, str]

_DELAYS: Final = (
    "also show the delay of this pair: how old the answer of a lookup without a time is; may be "
    "given several times"
)


@dataclass(frozen=True)
class PairDelay:
    """A pair of frames in a period.

    ``least_delay_s`` and ``greatest_delay_s``: how old the answer of a lookup without a time is,
    which is the age of the newest stamp of the oldest link between the frames. ``oldest_link``: the
    child frame of the link with the greatest delay. All three are None if ``problem`` says why
    there is no delay.
    """

    target: str
    source: str
    least_delay_s: float | None
    greatest_delay_s: float | None
    oldest_link: str | None
    problem: str | None


def add_pairs(parser: argparse.ArgumentParser, help_: str = _DELAYS) -> None:
    """Add further pairs of frames; by default those whose delays are shown."""
    parser.add_argument(
        "--pair",
        nargs=2,
        dest="pairs",
        action="append",
        metavar=("TARGET", "SOURCE"),
        default=[],
        help=help_,
    )


@dataclass
class PairWatch:
    """Collects the delays of a pair over several readings of all frames."""

    pair: Pair
    _seen: list[tuple[float, str]] = field(default_factory=list)  # delay and link
    _problem: str | None = None

    def add(self, frames: Mapping[str, FrameInfo], clock_ns: int) -> None:
        """Add a reading: the records of all frames by their names, and the clock at that time."""
        found = _oldest(self.pair, frames, clock_ns)
        if isinstance(found, str):
            self._problem = found
        else:
            self._seen.append(found)

    def result(self) -> PairDelay:
        """The delays so far."""
        if not self._seen:
            return PairDelay(*self.pair, None, None, None, self._problem)
        (least_s, _), (greatest_s, link) = min(self._seen), max(self._seen)
        return PairDelay(*self.pair, least_s, greatest_s, link, None)


def _oldest(pair: Pair, frames: Mapping[str, FrameInfo], clock_ns: int) -> tuple[float, str] | str:
    """The delay and the child frame of the oldest link of a pair, or why there is none."""
    for name in pair:
        if name not in frames:
            return f"no frame {quoted(name)}"
    up_target, up_source = ([frame.name for frame in path_to_root(name, frames)] for name in pair)
    if up_target[-1] != up_source[-1]:
        return f"not connected: the roots are {quoted(up_target[-1])} and {quoted(up_source[-1])}"
    links = set(up_target) ^ set(up_source)
    delays = [(d, name) for name in links if (d := frames[name].delay_s(clock_ns)) is not None]
    if not delays:
        return "static"
    oldest = max(delays)
    return oldest if abs(oldest[0]) <= CLOCK_RANGE_S else "the stamps are of another clock"
