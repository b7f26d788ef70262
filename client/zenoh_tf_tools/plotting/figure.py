"""Draws a pair's history with matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from zenoh_tf.text import cut, printable
from zenoh_tf_tools.plotting.pair import PairHistory

#: Labels, and the colours of the axes of a frame.
_AXES = (("x", "#d62728"), ("y", "#2ca02c"), ("z", "#1f77b4"))
_ANGLES = (("roll", "#d62728"), ("pitch", "#2ca02c"), ("yaw", "#1f77b4"))


def save(history: PairHistory, target: str, source: str, path: Path) -> None:
    """Write a figure of position, rotation and age over time.

    Args:
        history: What to draw.
        target: The frame that the poses are in.
        source: The frame whose poses they are.
        path: The file; its suffix says the format.

    Raises:
        OSError: The file cannot be written.
    """
    # Names are no formulas, whatever characters they have.
    with mpl.rc_context({"text.usetex": False, "text.parse_math": False}):
        figure = Figure(figsize=(9, 7), layout="constrained")
        position, rotation, age = figure.subplots(3, sharex=True, height_ratios=(3, 3, 2))
        figure.suptitle(f"{_name(source)} in {_name(target)}")
        _lines(position, history.times_s, history.poses[:, :3], _AXES)
        position.set_ylabel("position [m]")
        _lines(rotation, history.times_s, np.degrees(_angles(history.poses[:, 3:])), _ANGLES)
        rotation.set_ylabel("rotation [deg]")
        age.plot(history.times_s, history.ages_s, color="#444444", linewidth=1)
        age.set_ylabel("age [s]")
        age.set_ylim(bottom=min(0.0, np.nanmin([0.0, *history.ages_s])))
        age.set_xlabel("time [s]")
        for axes in (position, rotation, age):
            axes.grid(alpha=0.3)
            _shade(axes, history)
        figure.savefig(path, dpi=110)


def _lines(axes: Any, times_s: Any, columns: Any, labels: tuple[tuple[str, str], ...]) -> None:
    for column, (label, colour) in zip(columns.T, labels, strict=True):
        axes.plot(times_s, column, label=label, color=colour, linewidth=1)
    axes.legend(loc="upper left", ncols=3, fontsize="small")


def _shade(axes: Any, history: PairHistory) -> None:
    """Shade the times without an answer."""
    if history.answered.all():
        return
    axes.fill_between(
        history.times_s,
        0,
        1,
        where=~history.answered,
        transform=axes.get_xaxis_transform(),
        color="#d62728",
        alpha=0.12,
        linewidth=0,
        label="no answer",
        step="mid",
    )


def _angles(rotations: Any) -> Any:
    """Roll, pitch and yaw (n, 3) in radians about the fixed axes x, y, z; NaN between two of them
    that are a half turn or more apart, so that no line is drawn there."""
    x, y, z, w = rotations.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    angles = np.stack([roll, pitch, yaw], axis=1)
    angles[1:][np.abs(np.diff(angles, axis=0)) > np.pi] = np.nan
    return angles


def _name(text: str) -> str:
    return cut(printable(text), 60)
