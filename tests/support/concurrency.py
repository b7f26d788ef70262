"""The concurrency controls, for `pytest.mark.parametrize`: all but the default are slow."""

from __future__ import annotations

from typing import Any

import pytest

_TWO_PHASE = pytest.param("2pl", marks=pytest.mark.slow)

CONTROLS: list[Any] = ["optimistic", _TWO_PHASE, pytest.param("giant", marks=pytest.mark.slow)]
#: Those with a lock for each frame.
FRAME_LOCKS: list[Any] = ["optimistic", _TWO_PHASE]
