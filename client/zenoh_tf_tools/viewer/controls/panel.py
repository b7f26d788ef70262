"""The controls and figures beside the scene."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any, Final

import viser

from zenoh_tf_tools.viewer.controls.clock import Clock
from zenoh_tf_tools.viewer.controls.frame_list import FrameList
from zenoh_tf_tools.viewer.scene import ALL, NAMES

#: An entry of a list that stands for no frame; no frame's name is empty.
_NONE: Final = "(none)"
SHOW_ALL: Final = "show all"
GO_TO: Final = "go to frame"


class Panel:
    """The controls, whose values the viewer's thread reads, and what it shows in them."""

    def __init__(
        self,
        server: viser.ViserServer,
        *,
        range_ns: tuple[int, int] | None,
        at_ns: int,
        trail_s: float,
        has_robot: bool = False,
    ) -> None:
        """Make the controls.

        Args:
            server: Where to.
            range_ns: The times that can be chosen, in nanoseconds; None for a live tree.
            at_ns: The one of them to begin with.
            trail_s: Length of the trails to begin with, in seconds.
            has_robot: Whether there are shapes of a robot that can be shown.
        """
        gui = self._gui = server.gui
        # Beside the scene, not over it.
        gui.main_panel.dock_right()
        #: The buttons that were pressed and not yet heeded: `SHOW_ALL` or `GO_TO`.
        self.pressed = deque[str](maxlen=4)
        self._entries: dict[str, str] = {}  # what the lists show -> frame
        self.clock = Clock(gui, range_ns, at_ns)
        self.timeline = self._html("")
        self.status = self._html("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("view"):
            self._fixed: Any = gui.add_dropdown("fixed frame", [_NONE])
            self._frame: Any = gui.add_dropdown("frame", [_NONE], hint="or click one in the scene")
            camera = gui.add_button_group("camera", (SHOW_ALL, GO_TO))
            camera.on_click(lambda event: self.pressed.append(event.target.value))
            self.follow: Any = gui.add_checkbox(
                "follow frame", False, hint="the camera moves as the frame that is picked now does"
            )
            self.figures: Any = self._html("")
            self._add_drawing(range_ns is None, trail_s, has_robot)
        with tabs.add_tab("frames"):
            self.frames = FrameList(gui)
        with tabs.add_tab("faults"):
            self.faults: Any = self._html("")

    def _add_drawing(self, is_live: bool, trail_s: float, has_robot: bool) -> None:
        """Make the controls of how things are drawn."""
        gui = self._gui
        with gui.add_folder("drawing"):
            self.axes: Any = gui.add_slider("axes [x]", 0.1, 5.0, 0.1, 1.0)
            self.names: Any = gui.add_dropdown("names", NAMES, initial_value=ALL)
            most_s = 60.0 if is_live else max(60.0, self.clock.length_s)
            self.trail: Any = gui.add_slider("trail [s]", 0.0, most_s, 1.0, min(trail_s, most_s))
            self.estimate: Any = gui.add_checkbox(
                "estimate",
                True,
                hint="the picked frame as it is now, and a ball that it is in",
            )
            self.robot: Any = gui.add_slider(
                "robot", 0.0, 1.0, 0.1, 0.7, visible=has_robot, hint="how opaque its shapes are"
            )

    # --- what the person has chosen

    @property
    def fixed(self) -> str | None:
        return self._entries.get(self._fixed.value)

    @property
    def selected(self) -> str | None:
        return self._entries.get(self._frame.value)

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
