"""Draws frames, links, names and trails through viser; sends only what has changed.

All axes are one node of viser, and so are all origins, all links and all trails: a picture of 1,000
frames is a few messages. Names are labels that hang on nodes of their own, as only some are drawn.
A node's name is a number, never a frame's: a ``/`` in it would make it the child of another one,
and viser keeps something of every name that a node has ever had.

**The browser draws a batch of instances, a line, and a label that hangs on a node that has moved
one picture after it got the message, but a node itself at once.** On a slow browser a picture lasts
for a second. So nothing that is seen is moved by its own node's pose: all of it changes at once.

Coordinates are those of the fixed frame, less the scene's origin in 64 bits: the browser has only
32, and so a robot far from the origin of the earth does not shake. viser's quaternions are
(w, x, y, z).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import viser
from numpy.typing import NDArray
from trimesh.creation import icosphere

from zenoh_tf.text import cut, printable
from zenoh_tf_tools.viewer import labels
from zenoh_tf_tools.viewer.camera import Camera, grid_cell_m
from zenoh_tf_tools.viewer.placement import Placement
from zenoh_tf_tools.viewer.source import ViewedLink
from zenoh_tf_tools.viewer.trails import NO_TRAILS, Trails

Colour = tuple[int, int, int]

# The browser draws lines lighter than this.
FRESH: Final[Colour] = (0, 110, 80)
STATIC: Final[Colour] = (110, 115, 125)
AWAITED: Final[Colour] = (165, 165, 150)
STALE: Final[Colour] = (220, 0, 0)
FAULTY: Final[Colour] = (190, 0, 190)
#: The colours of a trail at its end and at its beginning.
TRAIL: Final = np.array((20, 60, 220))
PALE: Final = np.array((190, 205, 240))
SELECTED: Final[Colour] = (255, 150, 0)

#: Which names can be drawn: those of all frames, of roots and moving frames, or none.
ALL: Final = "where there is room"
MAIN: Final = "roots and moving"
NAMES: Final = (ALL, MAIN, "none")

_WXYZ: Final = [6, 3, 4, 5]
#: Characters of a frame's name that are drawn beside it.
_LABEL_CHARS: Final = 60
#: The axes of static frames are as long as this part of others: a robot has many, close together.
_STATIC_AXES: Final = 0.6
SELECTED_AXES: Final = 1.5


@dataclass(frozen=True)
class Look:
    """How to draw.

    Attributes:
        stale_s: From this age on, in seconds, a link is drawn as stale.
        axes_m: Length of the axes of frames that move, in metres.
        names: Which names to draw, one of `NAMES`.
        selected: The frame whose origin is marked, and whose name is always drawn.
        hidden: Frames that are not drawn.
        faults: What to write beside the names of frames that have a fault.
    """

    stale_s: float
    axes_m: float
    names: str
    selected: str | None
    hidden: frozenset[str]
    faults: Mapping[str, str]


def label_text(link: ViewedLink, stale_after_s: float, fault: str = "") -> str:
    """Return the text beside a frame; `fault`: what is wrong with it, in short."""
    state = " (not yet)" if link.is_awaited else ""
    state = " (stale)" if link.is_stale(stale_after_s) else state
    text = cut(printable(link.name), _LABEL_CHARS) + state
    return f"{text}: {fault}" if fault else text


def colour_of(link: ViewedLink, stale_after_s: float, faulty: bool = False) -> Colour:
    """Return the colour of a link and of its frame's origin."""
    if link.is_stale(stale_after_s):
        return STALE
    if faulty:
        return FAULTY
    if link.is_awaited:
        return AWAITED
    return STATIC if link.age_s is None else FRESH


def linear(colour: Sequence[float]) -> NDArray[np.uint8]:
    """Return what the browser must be given to draw instances in a colour of parts from 0 to 1:
    it takes their colours as linear, those of other meshes as sRGB."""
    parts = np.array(colour)
    parts = np.where(parts > 0.04045, ((parts + 0.055) / 1.055) ** 2.4, parts / 12.92)
    return np.round(255 * parts).astype(np.uint8)


class Node:
    """A node of viser, and what was sent of it."""

    def __init__(self, handle: Any, **sent: Any) -> None:
        self.handle: Any = handle
        self.sent = sent

    def set(self, **properties: Any) -> None:
        """Send the properties that are not as they were."""
        for name, value in properties.items():
            if name not in self.sent or not np.array_equal(self.sent[name], value):
                self.sent[name] = value
                setattr(self.handle, name, value)


class Scene:
    """The drawn scene. Only one thread calls it, within ``server.atomic()``."""

    def __init__(self, server: viser.ViserServer, on_click: Callable[[str], None]) -> None:
        """Draw nothing yet. `on_click` is called in another thread, with a frame's name."""
        self._scene = server.scene
        self._on_click = on_click
        #: (3,) where the scene's origin is in the fixed frame, in metres.
        self.origin = np.zeros(3)
        #: The frames that are drawn, in the order of the rows of axes and origins.
        self.drawn: list[str] = []
        self._grid = Node(self._scene.add_grid("/grid", infinite_grid=True))
        self._grid.set(cell_color=(225, 225, 225), section_color=(195, 195, 195))
        self._links = self._lines("/links", 2.5)
        self._trails = self._lines("/trails", 2.0)
        self._trail = NO_TRAILS
        #: From where a trail ended when it was drawn to where its frame is.
        self._heads = self._lines("/heads", 2.0)
        self._axes = self._origins = Node(None)
        # They are there before a label hangs on them: on a new one it would flash at the origin.
        self._spare = [
            Node(self._scene.add_frame(f"/names/{number}", show_axes=False))
            for number in range(labels.MAX_LABELS)
        ]
        self._labels: dict[str, tuple[Node, Node]] = {}
        self.measure(5.0)

    def measure(self, size_m: float) -> None:
        """Make the grid fit to a scene of this size, in metres."""
        cell_m = grid_cell_m(size_m)
        self._grid.set(cell_size=cell_m, section_size=cell_m * 10, fade_distance=size_m * 6)

    def draw(
        self, placement: Placement, links: Mapping[str, ViewedLink], look: Look, camera: Camera
    ) -> None:
        """Draw frames and links; frames that are not placed disappear.

        Args:
            placement: Where the frames are.
            links: Their links by name.
            look: How to draw them.
            camera: The camera that names must fit into.
        """
        self._move_origin()
        shown = [name for name in placement.names if name not in look.hidden]
        rows = [placement.rows[name] for name in shown]
        poses = placement.poses[rows] - (*self.origin, 0, 0, 0, 0)
        colours = [colour_of(links[x], look.stale_s, x in look.faults) for x in shown]
        self._draw_frames(shown, poses, links, colours, look)
        where = dict(zip(shown, poses, strict=True))
        ends, of_links = [], []
        for name, colour in zip(shown, colours, strict=True):
            parent = links[name].parent
            if parent in where:
                ends.append((where[parent][:3], where[name][:3]))
                of_links.append((colour, colour))
        self._links.set(
            points=np.array(ends, np.float32).reshape(-1, 2, 3),
            colors=np.array(of_links, np.uint8).reshape(-1, 2, 3),
        )
        points = (self._trail.segments - self.origin).astype(np.float32)
        age = 1 - self._trail.newness[..., None]
        self._trails.set(points=points, colors=(TRAIL + age * (PALE - TRAIL)).astype(np.uint8))
        heads = [
            (end - self.origin, where[name][:3])
            for name, end in self._trail.ends.items()
            if name in where
        ]
        self._heads.set(
            points=np.array(heads, np.float32).reshape(-1, 2, 3),
            colors=np.full((len(heads), 2, 3), TRAIL, np.uint8),
        )
        self._draw_labels(shown, poses[:, :3], links, look, camera)

    def set_trails(self, trails: Trails) -> None:
        """Draw these trails from the next picture on."""
        self._trail = trails

    def _lines(self, path: str, width: float) -> Node:
        none = np.zeros((0, 2, 3))
        lines = self._scene.add_line_segments(
            path, none, none.astype(np.uint8), thickness=width, thickness_units="screen"
        )
        return Node(lines, points=none, colors=none)

    def _move_origin(self) -> None:
        """Move the grid to where it is now."""
        section = self._grid.sent.get("section_size", 1.0)
        x, y, z = -self.origin
        self._grid.set(position=(x % section, y % section, z))

    def _draw_frames(
        self,
        shown: list[str],
        poses: NDArray[np.float64],
        links: Mapping[str, ViewedLink],
        colours: list[Colour],
        look: Look,
    ) -> None:
        if len(shown) != len(self.drawn):
            self._renew(len(shown))
        self.drawn = shown
        if not shown:
            return
        scales = np.array([_STATIC_AXES if links[x].static else 1.0 for x in shown], np.float32)
        if look.selected in shown:
            row = shown.index(look.selected)
            scales[row] = SELECTED_AXES
            colours = [*colours[:row], SELECTED, *colours[row + 1 :]]
        positions = poses[:, :3].astype(np.float32)
        wxyzs = poses[:, _WXYZ].astype(np.float32)
        self._axes.set(
            batched_positions=positions,
            batched_wxyzs=wxyzs,
            batched_scales=scales * look.axes_m,
        )
        self._origins.set(
            batched_positions=positions,
            batched_scales=scales * look.axes_m / 8,
            batched_colors=np.array(colours, np.uint8),
        )

    def _renew(self, count: int) -> None:
        """Make the nodes of axes and origins, for so many frames."""
        for node in (self._axes, self._origins):
            if node.handle is not None:
                node.handle.remove()
        self._axes = self._origins = Node(None)
        if count == 0:
            return
        turns = np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))
        places, sizes = np.zeros((count, 3), np.float32), np.ones(count, np.float32)
        axes = self._scene.add_batched_axes(
            "/axes", turns, places, sizes, axes_length=1.0, axes_radius=0.035
        )
        ball = icosphere(subdivisions=1)
        origins = self._scene.add_batched_meshes_simple(
            "/origins",
            ball.vertices,
            ball.faces,
            turns,
            places,
            batched_scales=sizes,
            batched_colors=np.zeros((count, 3), np.uint8),
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._axes, self._origins = Node(axes), Node(origins)
        axes.on_click(self._clicked)
        origins.on_click(self._clicked)

    def _clicked(self, event: Any) -> None:
        drawn = self.drawn
        if event.instance_index is not None and event.instance_index < len(drawn):
            self._on_click(drawn[event.instance_index])

    def _draw_labels(
        self,
        shown: list[str],
        positions: NDArray[np.float64],
        links: Mapping[str, ViewedLink],
        look: Look,
        camera: Camera,
    ) -> None:
        texts = [label_text(links[x], look.stale_s, look.faults.get(x, "")) for x in shown]
        pixels, inside = camera.project(positions)
        chosen = labels.choose(
            pixels,
            np.array([_rank(links[x], look) for x in shown], np.int64) * inside,
            np.array([*map(len, texts)], np.int64),
            np.array([x in self._labels for x in shown], bool),
            camera.width,
        )
        names = {shown[row] for row in chosen}
        for gone in self._labels.keys() - names:
            node, label = self._labels.pop(gone)
            label.handle.remove()
            self._spare.append(node)
        for row, anchor in chosen.items():
            node, label = self._labels.get(shown[row]) or self._new_label(shown[row])
            node.set(position=tuple(positions[row]))
            label.set(text=texts[row], anchor=anchor)

    def _new_label(self, name: str) -> tuple[Node, Node]:
        node = self._spare.pop()
        label = Node(self._scene.add_label(f"{node.handle.name}/text", ""))
        self._labels[name] = node, label
        return node, label


def _rank(link: ViewedLink, look: Look) -> int:
    """How important a name is; 0 if it is not to be drawn."""
    if link.name == look.selected:
        return 5
    if link.name in look.faults:
        return 4
    if look.names not in (ALL, MAIN):
        return 0
    if link.is_stale(look.stale_s) or link.parent is None:
        return 3
    if link.age_s is not None:
        return 2
    return 1 if look.names == ALL else 0
