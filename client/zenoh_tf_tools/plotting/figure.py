"""Draws the histories of pairs with matplotlib: panels over one axis of time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from zenoh_tf.text import cut, printable
from zenoh_tf.text.times import seconds
from zenoh_tf_tools.plotting.lookups import PairHistory

#: Labels, and the colours of the axes of a frame.
_AXES: Final = (("x", "#d62728"), ("y", "#2ca02c"), ("z", "#1f77b4"))
_ANGLES: Final = (("roll", "#d62728"), ("pitch", "#2ca02c"), ("yaw", "#1f77b4"))
_GREY: Final = "#444444"
_RED: Final = "#d62728"
#: Lines of the first pair and of the second one.
_STYLES: Final[tuple[Any, ...]] = ("-", (0, (4, 2)))
#: Inches of a panel, of the figure's width, and of what is around the panels.
_TALL, _LOW, _WIDTH, _AROUND = 2.2, 1.5, 10.0, 1.2


def save(histories: Sequence[PairHistory], path: Path, error: Any | None = None) -> None:
    """Write a figure: position, rotation, velocity if it is known, error, and age over time.

    Args:
        histories: One pair or two, which were asked at the same times.
        path: The file; its suffix says the format.
        error: The `pose_error` of the first pair, compared with the second; None if it is not to
            be drawn.

    Raises:
        OSError: The file cannot be written.
    """
    positions = [h.poses[:, :3] for h in histories]
    angles = [np.degrees(_angles(h.poses[:, 3:])) for h in histories]
    panels = [
        _Panel("position [m]", _TALL, positions, _AXES),
        _Panel("rotation [deg]", _TALL, angles, _ANGLES),
    ]
    velocities = [h.velocities for h in histories if h.velocities is not None]
    if velocities:
        turns = [np.degrees(v[:, 3:]) for v in velocities]
        panels.append(_Panel("velocity [m/s]", _TALL, [v[:, :3] for v in velocities], _AXES))
        panels.append(_Panel("velocity [deg/s]", _TALL, turns, _AXES))
    if error is not None:
        metres, radians = error
        panels.append(_Panel("error [m]", _LOW, [metres], from_zero=True))
        panels.append(_Panel("error [deg]", _LOW, [np.degrees(radians)], from_zero=True))
    panels.append(_Panel("age [s]", _LOW, [h.ages_s for h in histories], from_zero=True))
    # Names are no formulas, whatever characters they have.
    with mpl.rc_context({"text.usetex": False, "text.parse_math": False}):
        _draw(histories, panels).savefig(path, dpi=110)


class _Panel(NamedTuple):
    """What one panel has.

    Attributes:
        label: Of its axis, with the unit.
        inches: Its height.
        columns: For each pair (n, k) values, or (n,) with one label.
        labels: k names and colours; a line without a name is not in the legend.
        from_zero: Whether the axis has the 0.
    """

    label: str
    inches: float
    columns: list[Any]
    labels: tuple[tuple[str, str], ...] = (("", _GREY),)
    from_zero: bool = False


def _draw(histories: Sequence[PairHistory], panels: Sequence[_Panel]) -> Figure:
    """Panels below each other, each with the lines of all pairs."""
    heights = [panel.inches for panel in panels]
    figure = Figure(figsize=(_WIDTH, sum(heights) + _AROUND), layout="constrained")
    grid = figure.subplots(len(heights), sharex=True, height_ratios=heights, squeeze=False)
    times_s = histories[0].times_s
    for axes, panel in zip(grid[:, 0], panels, strict=True):
        for style, values in zip(_STYLES, panel.columns, strict=False):
            for column, (label, colour) in zip(
                values.reshape(len(values), -1).T, panel.labels, strict=True
            ):
                # The legend has the colours once, whatever the number of pairs.
                name = label if label and style == _STYLES[0] else None
                axes.plot(times_s, column, label=name, color=colour, linewidth=1, linestyle=style)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        axes.set_ylabel(panel.label)
        axes.grid(alpha=0.3)
        axes.margins(x=0)
        if panel.from_zero:
            least = np.nanmin([0.0, *panel.columns[0], *panel.columns[-1]])
            axes.set_ylim(bottom=min(0.0, least))
        _shade(axes, histories)
    grid[-1, 0].set_xlabel(f"time [s] since {seconds(int(histories[0].stamps_ns[0]))} s")
    figure.align_ylabels()
    _name(figure, histories)
    return figure


def _shade(axes: Any, histories: Sequence[PairHistory]) -> None:
    """Shade the times at which a pair has no answer."""
    for history in histories:
        axes.fill_between(
            history.times_s,
            0,
            1,
            where=~history.answered,
            transform=axes.get_xaxis_transform(),
            color=_RED,
            alpha=0.12,
            linewidth=0,
            step="mid",
        )


def _name(figure: Figure, histories: Sequence[PairHistory]) -> None:
    """Say which pairs are drawn, and what shades mean, outside of the panels."""
    names = [f"{_printed(h.source)} in {_printed(h.target)}" for h in histories]
    if len(names) == 1:
        figure.suptitle(names[0])
    else:
        lines = [
            Line2D([], [], color=_GREY, linewidth=1, linestyle=style, label=name)
            for style, name in zip(_STYLES, names, strict=True)
        ]
        figure.legend(handles=lines, loc="outside upper center", frameon=False)
    if not all(history.answered.all() for history in histories):
        shade = Patch(color=_RED, alpha=0.12, linewidth=0, label="no answer")
        figure.legend(handles=[shade], loc="outside lower right", frameon=False)


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


def _printed(text: str) -> str:
    return cut(printable(text), 60)
