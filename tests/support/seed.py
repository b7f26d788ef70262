"""The seed of a random test: ``SEED``, or 1 in a short run, which all changes must pass alike."""

from __future__ import annotations

import os
import random


def seed(long: object) -> int:
    """The seed of this run. `long`: true if the run is a long one, which searches further."""
    if "SEED" in os.environ:
        return int(os.environ["SEED"])
    return random.SystemRandom().randrange(1 << 32) if long else 1
