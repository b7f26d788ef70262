"""Stamps that are in seconds, milliseconds or microseconds, where nanoseconds belong."""

from __future__ import annotations

from typing import Final

from zenoh_tf._core import other_unit

__all__ = ["POWERS", "other_unit"]

#: Units that a stamp may be in by mistake, as powers of ten nanoseconds.
POWERS: Final = {"seconds": 9, "milliseconds": 6, "microseconds": 3}
