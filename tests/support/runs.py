"""What a short run of the tests leaves out: random seeds, and concurrency controls."""

from __future__ import annotations

import os
import random
from typing import Any

import pytest

_TWO_PHASE = pytest.param("2pl", marks=pytest.mark.slow)

#: For `pytest.mark.parametrize`: all but the default are slow.
CONTROLS: list[Any] = ["optimistic", _TWO_PHASE, pytest.param("giant", marks=pytest.mark.slow)]
#: Those with a lock for each frame.
FRAME_LOCKS: list[Any] = ["optimistic", _TWO_PHASE]


def seed(long: object) -> int:
    """The seed of this run: ``SEED``, or 1 in a short run, which all changes must pass alike.
    `long`: true if the run is a long one, which searches further."""
    if "SEED" in os.environ:
        return int(os.environ["SEED"])
    return random.SystemRandom().randrange(1 << 32) if long else 1
