"""A viewer of a tree in this process, and what it hands to viser."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Iterator, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_tools.doctor import TreeFacts
from zenoh_tf_tools.viewer.models import Model
from zenoh_tf_tools.viewer.source import ViewedLink
from zenoh_tf_tools.viewer.viewer import Options, Viewer

S = 10**9
QUARTER = (0.0, 0.0, 0.5**0.5, 0.5**0.5)


class Tree:
    """A tree in this process, at a time that the test sets."""

    range_ns: tuple[int, int] | None = None

    def __init__(self) -> None:
        self.lookups = TransformTree()
        self.time_ns = S
        self.reported: str | None = None

    def set(self, parent: str, child: str, x: float, stamp_ns: int = S, **options: Any) -> None:
        stamped = StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0), QUARTER))
        self.lookups.set_transform(stamped, **options)

    def names(self) -> list[str]:
        return self.lookups.frames()

    def link(self, name: str, time_ns: int, *, past: bool = False) -> ViewedLink | None:
        if name not in self.lookups.frames():
            return None
        frame = self.lookups.frame(name)
        stamp_ns = frame.newest_stamp_ns
        moves = not frame.static and frame.parent is not None and stamp_ns is not None
        age_s = (time_ns - (stamp_ns or 0)) / 1e9 if moves else None
        return ViewedLink(name, frame.parent, frame.static, stamp_ns, age_s, None, frame.authority)

    def now_ns(self, links: Any) -> int:
        return self.time_ns

    def step_ns(self, names: Any, time_ns: int, step: int) -> int:
        return time_ns + step * S // 10

    def spans_ns(self, name: str) -> list[tuple[int, int]]:
        return []

    def trouble(self) -> str | None:
        return self.reported


def options(max_frames: int = 100) -> Options:
    return Options(stale_s=1.0, max_frames=max_frames, at_ns=0, fixed=None, axes_m=0.2, trail_s=5.0)


def nothing(stopped: Callable[[], bool]) -> Generator[TreeFacts, None, None]:
    """What is observed of a tree without frames."""
    yield TreeFacts([], 0)


@contextlib.contextmanager
def opened(server: Any, tree: Tree, models: Sequence[Model] = (), **how: Any) -> Iterator[Viewer]:
    viewer = Viewer(tree, server, options(**how), nothing, models)
    try:
        yield viewer
    finally:
        viewer.close()
        server.scene.reset()
        server.gui.reset()


class Drawn(NamedTuple):
    """What viser was given of a frame."""

    position: Any
    wxyz: Any
    axes_m: float
    colour: tuple[int, ...]
    label: str | None


def step(viewer: Viewer) -> dict[str, Drawn]:
    """One picture, with everything that is otherwise drawn less often."""
    viewer._slow_at_s = 0.0
    viewer.step()
    drawn = viewer.scene
    names = {name: label.handle for name, (_, label) in drawn._labels.items()}
    axes, origins = drawn._axes.handle, drawn._origins.handle
    return {
        name: Drawn(
            axes.batched_positions[row].copy(),  # viser keeps its array
            axes.batched_wxyzs[row],
            axes.batched_scales[row],
            tuple(origins.batched_colors[row].tolist()),
            names[name].text if name in names else None,
        )
        for row, name in enumerate(drawn.drawn)
    }


def click(viewer: Viewer, name: str) -> None:
    """What viser's thread does when a person clicks a frame."""
    row = viewer.scene.drawn.index(name)
    for callback in viewer.scene._origins.handle._impl.click_cb:
        callback.callback(SimpleNamespace(instance_index=row))
