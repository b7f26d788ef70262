"""Times of points that are given as offsets from a sweep's begin.

Drivers send them as unsigned 32-bit nanoseconds: an offset before the begin then wraps round to
4.29 s. A lost column has the offset 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_WRAP: Final = 1 << 32
#: An offset this close to the wrap, among others that are this short, is a negative one.
_NEAR: Final = 1 << 30


def absolute(
    offsets: NDArray[np.int64], begin_ns: int, *, narrow: bool
) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """Return the times, and which points have none, or None if all have one.

    `narrow`: the offsets were unsigned 32-bit numbers. An offset of 0 is none if it is farther from
    all others than these are from each other.
    """
    wrapped = (offsets >= _WRAP - _NEAR) & (offsets < _WRAP)
    others_are_short = not wrapped.all() and bool((offsets[~wrapped] < _NEAR).all())
    if wrapped.any() and (narrow or others_are_short):
        offsets = np.where(wrapped, offsets - _WRAP, offsets)
    zero = offsets == 0
    lost = None
    if zero.any() and not zero.all():
        others = offsets[~zero]
        low, high = int(others.min()), int(others.max())
        if max(low, -high) > high - low:
            lost = zero
    return begin_ns + offsets, lost
