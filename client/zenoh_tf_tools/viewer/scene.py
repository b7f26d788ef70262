"""Draws frames, links and trails through viser; sends only what has changed.

viser's quaternions are (w, x, y, z). Every frame's node is given its pose in the fixed frame, so a
new parent changes no node. Nodes have numbers in place of names: a ``/`` in a node's name would
make it the child of another one, and viser keeps something of every name that a node has ever had.
The node of a frame that is gone is hidden, and serves the next new frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import viser
from numpy.typing import NDArray

from zenoh_tf.text import cut, printable
from zenoh_tf_tools.viewer.placement import Placement
from zenoh_tf_tools.viewer.source import Link

Colour = tuple[int, int, int]

# The browser draws lines lighter than this.
FRESH: Final[Colour] = (0, 110, 80)
STATIC: Final[Colour] = (110, 115, 125)
STALE: Final[Colour] = (220, 0, 0)
TRAIL: Final[Colour] = (20, 60, 220)
SELECTED: Final[Colour] = (255, 150, 0)

#: Which names can be drawn: those of all frames, of roots and moving frames, or none.
ALL: Final = "all"
MAIN: Final = "roots and moving"
NAMES: Final = (MAIN, ALL, "none")

_WXYZ: Final = [6, 3, 4, 5]
#: Characters of a frame's name that are drawn beside it.
_LABEL_CHARS: Final = 60


@dataclass
class _Node:
    """What viser draws of one frame."""

    name: str
    frame: Any
    label: Any
    pose: NDArray[np.float64]
    colour: Colour
    text: str
    named: bool
    axes_m: float


def label_text(link: Link, stale: bool) -> str:
    """Return the text beside a frame."""
    return cut(printable(link.name), _LABEL_CHARS) + (" (stale)" if stale else "")


def colour_of(link: Link, stale_after_s: float) -> Colour:
    """Return the colour of a link and of its frame's origin."""
    if link.is_stale(stale_after_s):
        return STALE
    return STATIC if link.age_s is None else FRESH


class _Lines:
    """Segments that are drawn as one node."""

    def __init__(self, scene: viser.SceneApi, path: str, width: float) -> None:
        self.points = np.zeros((0, 2, 3), np.float32)
        self.colours = np.zeros((0, 2, 3), np.uint8)
        self._lines: Any = scene.add_line_segments(
            path, self.points, self.colours, thickness=width, thickness_units="screen"
        )

    def draw(self, points: NDArray[np.float32], colours: NDArray[np.uint8]) -> None:
        """Draw these segments, (n, 2, 3) in metres, in the colours of their ends."""
        if not np.array_equal(points, self.points):
            self.points = points
            self._lines.points = points
        if not np.array_equal(colours, self.colours):
            self.colours = colours
            self._lines.colors = colours


class Scene:
    """The drawn scene. Only one thread calls it, within ``server.atomic()``."""

    def __init__(self, server: viser.ViserServer, on_click: Callable[[str], None]) -> None:
        """Draw nothing yet. `on_click` is called in another thread, with a frame's name."""
        self._scene = server.scene
        self._on_click = on_click
        self._nodes: dict[str, _Node] = {}
        self._hidden: list[_Node] = []
        self._scene.add_grid(
            "/grid",
            infinite_grid=True,
            cell_size=1.0,
            cell_color=(225, 225, 225),
            section_size=5.0,
            section_color=(195, 195, 195),
            fade_distance=40.0,
        )
        self._links = _Lines(self._scene, "/links", 2.5)
        self._trails = _Lines(self._scene, "/trails", 2.0)

    def draw(
        self,
        placement: Placement,
        links: Mapping[str, Link],
        stale_after_s: float,
        *,
        axes_m: float,
        names: str,
        selected: str | None,
    ) -> None:
        """Draw frames and links; frames that are not placed disappear.

        Args:
            placement: Where the frames are.
            links: Their links by name.
            stale_after_s: From this age on, in seconds, a link is drawn as stale.
            axes_m: Length of the frames' axes, in metres. Those of static frames are half as long:
                a robot has many of them, close together.
            names: Which names to draw, one of `NAMES`.
            selected: The frame whose origin is marked, and whose name is drawn.
        """
        for gone in self._nodes.keys() - placement.rows.keys():
            node = self._nodes.pop(gone)
            node.frame.visible = False
            self._hidden.append(node)
        ends, colours = [], []
        for name, pose in zip(placement.names, placement.poses, strict=True):
            link = links[name]
            colour = colour_of(link, stale_after_s)
            chosen = name == selected
            self._draw_frame(
                name,
                pose,
                colour=SELECTED if chosen else colour,
                text=label_text(link, colour == STALE),
                named=chosen or names == ALL or (names == MAIN and not link.static),
                axes_m=axes_m / 2 if link.static and not chosen else axes_m,
            )
            row = None if link.parent is None else placement.rows.get(link.parent)
            if row is not None:
                ends.append((placement.poses[row, :3], pose[:3]))
                colours.append((colour, colour))
        self._links.draw(
            np.array(ends, np.float32).reshape(-1, 2, 3),
            np.array(colours, np.uint8).reshape(-1, 2, 3),
        )

    def draw_trails(self, segments: NDArray[np.float32]) -> None:
        """Draw line segments (n, 2, 3), in metres."""
        self._trails.draw(segments, np.full(segments.shape, TRAIL, np.uint8))

    def _draw_frame(
        self,
        name: str,
        pose: NDArray[np.float64],
        *,
        colour: Colour,
        text: str,
        named: bool,
        axes_m: float,
    ) -> None:
        node = self._nodes.get(name)
        if node is None:
            node = self._nodes[name] = self._new(name)
        if not np.array_equal(node.pose, pose):
            node.pose = pose
            node.frame.position = pose[:3]
            node.frame.wxyz = pose[_WXYZ]
        if colour != node.colour:
            node.colour = colour
            node.frame.origin_color = colour
        if text != node.text:
            node.text = text
            node.label.text = text
        if named != node.named:
            node.named = named
            node.label.visible = named
        if axes_m != node.axes_m:
            node.axes_m = axes_m
            node.frame.axes_length = axes_m
            node.frame.axes_radius = axes_m / 25
            node.frame.origin_radius = axes_m / 8

    def _new(self, name: str) -> _Node:
        """A node for a frame, whose state is unlike that of any frame."""
        if self._hidden:
            node = self._hidden.pop()
            node.name = name
            node.frame.visible = True
            return node
        path = f"/frames/{len(self._nodes)}"
        frame = self._scene.add_frame(path)
        label = self._scene.add_label(f"{path}/name", "", anchor="bottom-left")
        node = _Node(name, frame, label, np.full(7, np.nan), (0, 0, 0), "", True, 0.0)
        frame.on_click(lambda _: self._on_click(node.name))
        return node
