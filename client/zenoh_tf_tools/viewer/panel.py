"""The controls and figures beside the scene.

Frames and authorities may have any name. So names are shown as escaped HTML, never through viser's
Markdown: its pages execute expressions in it.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import viser

from zenoh_tf.text import cut, printable
from zenoh_tf.text.times import age, seconds
from zenoh_tf_tools.viewer.placement import Placement
from zenoh_tf_tools.viewer.scene import MAIN, NAMES
from zenoh_tf_tools.viewer.source import Link

#: Names of one list in the panel; more are counted.
_LISTED: Final = 8
_SPEEDS: Final = ("0.1 x", "0.5 x", "1 x", "2 x", "5 x", "20 x")
#: An entry of a list that stands for no frame; no frame's name is empty.
_NONE: Final = "(none)"


class Panel:
    """The controls, which the viewer's thread reads, and what it shows in them."""

    def __init__(
        self,
        server: viser.ViserServer,
        *,
        range_ns: tuple[int, int] | None,
        at_ns: int,
        axes_m: float,
        trail_s: float,
    ) -> None:
        """Make the controls.

        Args:
            server: Where to.
            range_ns: The times that can be chosen, in nanoseconds; None for a live tree.
            at_ns: The one of them to begin with.
            axes_m: Length of the frames' axes to begin with, in metres.
            trail_s: Length of the trails to begin with, in seconds.
        """
        gui = self._gui = server.gui
        self._range_ns = range_ns
        self._entries: dict[str, str] = {}  # what the lists show -> frame
        self._shown: dict[str, str] = {}
        if range_ns is not None:
            length_s = max(0.01, (range_ns[1] - range_ns[0]) / 1e9)
            at_s = (at_ns - range_ns[0]) / 1e9
            self._time: Any = gui.add_slider(
                "time [s]", 0.0, length_s, 0.01, min(max(0.0, at_s), length_s)
            )
            self._play: Any = gui.add_checkbox("play", False)
            self._speed: Any = gui.add_dropdown("speed", _SPEEDS, initial_value="1 x")
        self._fixed: Any = gui.add_dropdown("fixed frame", [_NONE])
        self._frame: Any = gui.add_dropdown("frame", [_NONE], hint="or click a frame in the scene")
        self.figures: Any = self._html("")
        self.go_to = gui.add_button("go to frame")
        self._axes = gui.add_slider("axes [m]", 0.02, 2.0, 0.02, axes_m)
        self._names = gui.add_dropdown("names", NAMES, initial_value=MAIN)
        most_s = 60.0 if range_ns is None else max(60.0, length_s)
        self._trail: Any = gui.add_slider("trail [s]", 0.0, most_s, 1.0, min(trail_s, most_s))
        self.status = self._html("")

    # --- what the person has chosen

    @property
    def fixed(self) -> str | None:
        return self._entries.get(self._fixed.value)

    @property
    def selected(self) -> str | None:
        return self._entries.get(self._frame.value)

    @property
    def axes_m(self) -> float:
        return float(self._axes.value)

    @property
    def names(self) -> str:
        return str(self._names.value)

    @property
    def trail_s(self) -> float:
        return float(self._trail.value)

    def time_ns(self, elapsed_s: float) -> int:
        """The time to show, in nanoseconds; while it plays, `elapsed_s` after the last one."""
        assert self._range_ns is not None
        if self._play.value:
            seconds = self._time.value + elapsed_s * float(self._speed.value.split()[0])
            if seconds >= self._time.max:
                self._play.value = False
            self._time.value = min(seconds, self._time.max)
        return self._range_ns[0] + int(self._time.value * 1e9)

    # --- what it shows

    def offer(self, names: Sequence[str], fixed: str | None) -> None:
        """Offer these frames; `fixed`: the fixed frame, if the one that was chosen is gone."""
        entries = {entry_of(name): name for name in sorted(names)}
        if entries != self._entries:
            chosen = self._fixed.value, self._frame.value
            self._entries = entries
            for dropdown, value in zip((self._fixed, self._frame), chosen, strict=True):
                dropdown.options = (_NONE, *entries)
                dropdown.value = value if value in entries else _NONE
        if self.fixed is None and fixed is not None:
            self._fixed.value = entry_of(fixed)

    def select(self, name: str) -> None:
        """Show the figures of a frame."""
        if entry_of(name) in self._entries:
            self._frame.value = entry_of(name)

    def show(self, handle: Any, content: str) -> None:
        """Set an HTML element; nothing is sent if it has this content."""
        if handle.content != content:
            handle.content = content

    def _html(self, content: str) -> Any:
        return self._gui.add_html(content)


def entry_of(name: str) -> str:
    """A frame in a list; no two frames are alike there."""
    return name if name != _NONE else f" {name}"


def figures_html(link: Link | None, placement: Placement, fixed: str) -> str:
    """The figures of one frame, as HTML."""
    if link is None:
        return _block("Click a frame, or choose one.")
    facts = {"parent": "none, it is a root" if link.parent is None else _name(link.parent)}
    if link.parent is not None:
        facts["authority"] = _name(link.authority) if link.authority else "-"
        if link.static:
            facts["age"] = "static: holds at all times"
        elif link.age_s is not None and link.age_s < 0:
            facts["age"] = f"its first sample comes in {age(int(-link.age_s * 1e9))}"
        elif link.age_s is not None:
            facts["age"] = age(int(link.age_s * 1e9))
        if not link.static:
            facts["rate"] = "-" if link.rate_hz is None else f"{link.rate_hz:.1f} Hz"
    row = placement.rows.get(link.name)
    if row is None:
        facts["position"] = f"not connected to {_name(fixed)}"
    else:
        x, y, z = placement.poses[row, :3] + 0.0
        facts["position"] = f"{x:.3f}, {y:.3f}, {z:.3f} m in {_name(fixed)}"
    rows = "".join(
        f"<tr><td style='padding-right:1em;opacity:0.6'>{label}</td><td>{value}</td></tr>"
        for label, value in facts.items()
    )
    return _block(f"<b>{_name(link.name)}</b><table>{rows}</table>")


def status_html(
    links: Mapping[str, Link],
    placement: Placement,
    fixed: str,
    stale_after_s: float,
    time_ns: int,
    hidden: int,
    trouble: str | None,
) -> str:
    """What is shown, what is stale, and what is not shown, as HTML."""
    lines = []
    if trouble is not None:
        lines.append(f"<b style='color:#d22'>{html.escape(trouble)}</b>")
    lines.append(f"at {seconds(time_ns)[:-6]} s")
    moving = sum(link.age_s is not None for link in links.values())
    lines.append(f"{len(links):,} frames, {moving:,} moving")
    if hidden:
        lines.append(f"{hidden:,} more frames are not shown (--max-frames)")
    stale = [link.name for link in links.values() if link.is_stale(stale_after_s)]
    if stale:
        lines.append(
            f"<span style='color:#d22'>{len(stale):,} stale (over {stale_after_s:g} s): "
            f"{_list(stale)}</span>"
        )
    if placement.elsewhere:
        others = sum(placement.elsewhere.values())
        lines.append(
            f"{others:,} not connected to {_name(fixed)}, below: {_list([*placement.elsewhere])}"
        )
    return _block("<br>".join(lines))


def look_from(positions: Sequence[np.ndarray[Any, Any]]) -> tuple[Any, Any]:
    """Return a camera's position and the point it looks at, which show these positions."""
    points = np.array(positions).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    centre = (low + high) / 2
    distance = max(1.0, float(np.linalg.norm(high - low)))
    return centre + distance * np.array([-0.45, -0.6, 0.5]), centre


def _block(content: str) -> str:
    return f"<div style='font-size:0.85em;padding:0.2em 1em'>{content}</div>"


def _name(name: str) -> str:
    return html.escape(cut(printable(name), 60))


def _list(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED:,} more" if len(names) > _LISTED else ""
    return ", ".join(map(_name, names[:_LISTED])) + more
