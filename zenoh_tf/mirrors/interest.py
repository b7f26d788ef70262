"""The interest of a mirror, from what its owner asks for: pairs of frames, a delay, a rate.

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from .. import wire
from ..errors import InvalidArgumentException, must_be

#: Bounds of a rate, in Hz.
LOWEST_HZ: Final = 0.001
HIGHEST_HZ: Final = 1000.0
#: How long the server gathers changes of the pairs' frames, if not said otherwise, and at most.
_DELAY_S: Final = 0.05
_LONGEST_DELAY_S: Final = 10.0


def interest_of(
    pairs: Sequence[tuple[str, str]] | None, max_delay_s: float | None, max_rate_hz: float | None
) -> wire.Interest | None:
    """The interest of a mirror; None: everything, at once. Raises InvalidArgumentException."""
    if pairs is not None:
        _check_pairs(pairs)
    period_ns = 0
    if max_rate_hz is not None:
        rate = float(max_rate_hz)
        if not (math.isfinite(rate) and LOWEST_HZ <= rate <= HIGHEST_HZ):
            limits = f"from {LOWEST_HZ:g} to {HIGHEST_HZ:g}"
            raise must_be("max_rate_hz", limits, max_rate_hz)
        period_ns = round(1e9 / rate)
    if max_delay_s is not None and (pairs is None or period_ns):
        raise InvalidArgumentException(
            "max_delay_s is for a mirror of pairs without max_rate_hz", field="max_delay_s"
        )
    if pairs is None and not period_ns:
        return None
    delay_s = _DELAY_S if max_delay_s is None else float(max_delay_s)
    if not 0 <= delay_s <= _LONGEST_DELAY_S:
        raise must_be("max_delay_s", f"from 0 to {_LONGEST_DELAY_S:g}", max_delay_s)
    return wire.Interest.of(pairs or (), period_ns, 0 if period_ns else round(delay_s * 1e9))


def _check_pairs(pairs: Sequence[tuple[str, str]]) -> None:
    if isinstance(pairs, str) or not pairs:
        raise InvalidArgumentException(
            f"pairs must be a list of pairs of frames, not {pairs!r}; without it, the mirror has "
            "all frames",
            field="pairs",
        )
    for pair in pairs:
        if isinstance(pair, str) or len(pair) != 2:
            raise InvalidArgumentException(
                f"pairs must have two frames each, target and source, not {pair!r}", field="pairs"
            )
        for name in pair:
            if not isinstance(name, str) or not name or not _is_utf8(name):
                raise InvalidArgumentException(
                    f"pairs must have names of frames, not {name!r}", field="pairs"
                )


def _is_utf8(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
