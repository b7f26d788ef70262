"""An estimate's bounds in words, as the command line and the viewer show them."""

from __future__ import annotations

import math

from zenoh_tf import Estimate
from zenoh_tf.text import printable
from zenoh_tf.text.times import age


def bounds(found: Estimate) -> str:
    """The bounds of an estimate's errors, and what they rest on."""
    if found.basis == "static":
        return "none: all links are static"
    within = f"within {metres(found.error_m)} and {math.degrees(found.error_rad):.2g} deg"
    level = f"level {found.level:.3g} of {found.backtests} backtests"
    if found.basis == "limits":
        level += ", and the declared limits of motion"
    return f"{within} ({level})"


def carried_on(found: Estimate) -> str:
    """How far and how links were carried beyond their newest samples; empty if none was."""
    if found.by_ns <= 0:
        return ""
    how = ", ".join(f"{child} by {predictor}" for child, predictor in found.predictor.items())
    return f"{age(found.by_ns)}: {printable(how)}"


def metres(value: float) -> str:
    """A length with two digits, in the unit that suits it."""
    if not math.isfinite(value):
        return "any length"
    unit, size = ("m", 1.0) if value >= 1 else ("cm", 1e-2) if value >= 1e-2 else ("mm", 1e-3)
    return f"{float(f'{value / size:.2g}'):g} {unit}"
