"""Which names are drawn: as many as fit beside each other, the most important first."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Most names at a time: with more, a person reads none.
MAX_LABELS: Final = 60
#: About how large viser draws text, in pixels: a character's width, a line's height, the gap
#: between a frame's origin and its name.
_CHARACTER: Final = 6.4
_LINE: Final = 19.0
_MARGIN: Final = 6.0
# viser's names of the corner of a text that is at its frame.
RIGHT: Final = "bottom-left"
_LEFT: Final = "bottom-right"


def choose(
    pixels: NDArray[np.float64],
    rank: NDArray[np.int64],
    lengths: NDArray[np.int64],
    drawn: NDArray[np.bool_],
    width: int,
) -> dict[int, str]:
    """Return the rows of the names to draw, so that no two overlap, and viser's anchor of each.

    Args:
        pixels: (n, 2) where the frames are in the window. Their names are above and right of
            there, or left if the window ends.
        rank: (n,) how important they are; 0 is for names that are not to be drawn.
        lengths: (n,) characters of the names.
        drawn: (n,) which names are drawn now. Of equally important ones they come first, so that
            names do not flicker.
        width: Of the window, in pixels.
    """
    order = np.lexsort((np.arange(len(rank)), ~drawn, -rank))[: np.count_nonzero(rank)]
    at_x, bottom = pixels[order].T
    lengths_px = lengths[order] * _CHARACTER + _MARGIN
    turned = at_x + lengths_px > width
    left = np.where(turned, at_x - lengths_px, at_x)
    right, top = left + lengths_px, bottom - _LINE
    chosen: dict[int, str] = {}
    free = np.ones(len(order), bool)  # overlaps none of the chosen ones
    while len(chosen) < MAX_LABELS and free.any():
        at = int(free.argmax())
        chosen[int(order[at])] = _LEFT if turned[at] else RIGHT
        free &= (
            (left >= right[at]) | (left[at] >= right) | (top >= bottom[at]) | (top[at] >= bottom)
        )
    return chosen
