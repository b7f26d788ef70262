"""Logs a tree to Rerun: its frames by name, each link as a `Transform3D` between two of them.

Every frame is an entity ``frames/NAME``. Rerun joins the links by the names of their frames, so a
link that gets another parent is one more row of its entity. The timeline ``stamp`` has the times of
the tree. A static link is static in Rerun, too, and stays so if it begins to move: there its newest
pose holds at all times.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.urdf import UrdfTree

from zenoh_tf.urdf import reader
from zenoh_tf.urdf.kinematics import link_of
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.viewer.changes import LinkChanges
from zenoh_tf_tools.viewer.placement import roots_by_size
from zenoh_tf_tools.viewer.source import ViewedLink, ViewedTree

#: The timeline of the tree's times.
TIMELINE: Final = "stamp"
#: How long a viewer may take for what it is sent, in seconds.
_FLUSH_S: Final = 30.0
#: Most rows that wait until they are logged.
_MOST_ROWS: Final = 20_000


class RerunLog:
    """Logs pictures of a tree to a stream of Rerun.

    Thread safety: none.
    """

    def __init__(
        self,
        source: ViewedTree,
        stream: rr.RecordingStream,
        urdf: Sequence[Path] = (),
        fixed: str | None = None,
        axes_m: float = 0.1,
    ) -> None:
        """Log nothing yet.

        Args:
            source: The tree.
            stream: Where to log.
            urdf: Robots, whose shapes are logged at the frames of their links, whatever prefix
                these have.
            fixed: The frame that stands still; None: the root of most frames.
            axes_m: The length of the frames' axes, in metres.

        Raises:
            CommandError: A URDF file cannot be read.
            InvalidArgumentException: It is no URDF.
        """
        self._source = source
        self._stream = stream
        self._fixed = fixed
        self._axes_m = axes_m
        self._robots = {path: _links_of(path) for path in urdf}
        self._shown: set[tuple[Path, str]] = set()  # robots, with their prefixes
        self._changes = LinkChanges(source)
        self._static: set[str] = set()
        self._known: set[str] = set()
        self._root = ""
        self._rows: dict[str, list[tuple[int, str, NDArray[np.float64]]]] = defaultdict(list)
        self._waiting = 0

    def step(self, time_ns: int, *, past: bool) -> list[ViewedLink]:
        """Log what is new at a time.

        Args:
            time_ns: The time, in nanoseconds; a live tree takes it for the ages only.
            past: Whether the tree as it was then is meant; else a live tree's newest samples.

        Returns:
            All links.
        """
        found = (self._source.link(x, time_ns, past=past) for x in self._source.names())
        links = [link for link in found if link is not None]
        self._begin(links)
        # Before its first sample a link is not there yet.
        begun = [x for x in links if x.age_s is None or x.age_s >= 0]
        for link, pose in self._changes.take(begun):
            if link.static or link.name in self._static:
                self._static.add(link.name)
                self._stream.log(_entity(link.name), _transform(link, pose), static=True)
                continue
            stamp_ns, parent = link.sample_ns or 0, link.parent or ""
            self._rows[link.name].append((stamp_ns, parent, pose))
            self._waiting += 1
        if self._waiting >= _MOST_ROWS:
            self.send()
        return links

    def send(self) -> None:
        """Hand what was logged to Rerun, and wait until it has it.

        Raises:
            CommandError: The viewer is gone, or the file cannot be written.
        """
        for name, rows in self._rows.items():
            stamps, parents, poses = zip(*rows, strict=True)
            pose = np.array(poses)
            self._stream.send_columns(
                _entity(name),
                [rr.TimeColumn(TIMELINE, timestamp=np.array(stamps, "datetime64[ns]"))],
                rr.Transform3D.columns(
                    translation=pose[:, :3],
                    quaternion=pose[:, 3:],
                    parent_frame=list(parents),
                    child_frame=[name] * len(rows),
                ),
            )
        self._rows.clear()
        self._waiting = 0
        # Without this, what a slow viewer has not taken yet would grow without limit.
        try:
            self._stream.flush(timeout_sec=_FLUSH_S)
        except RuntimeError as error:
            raise CommandError(f"Rerun takes no more: {error}") from error

    def _begin(self, links: Sequence[ViewedLink]) -> None:
        """Show new frames, and choose the one that stands still."""
        new = [link.name for link in links if link.name not in self._known]
        if not new:
            return
        self._known.update(new)
        for name in new:
            axes = rr.TransformAxes3D(self._axes_m, show_frame=True)
            self._stream.log(_entity(name), rr.CoordinateFrame(name), axes, static=True)
        for path, robot in self._robots.items():
            for prefix in sorted(_prefixes(robot, new) - {p for f, p in self._shown if f == path}):
                self._shown.add((path, prefix))
                entity = f"{path.stem} {prefix.rstrip('/')}".rstrip()
                model = UrdfTree.from_file_path(path, entity, frame_prefix=prefix)
                self._stream.send_chunks(model.stream(include_joint_transforms=False))
        root = self._fixed or roots_by_size({link.name: link for link in links})[0]
        if root != self._root:
            self._root = root
            view = rrb.Spatial3DView(
                name=f"frames in {root}",
                spatial_information=rrb.SpatialInformation(target_frame=root),
            )
            times = rrb.TimePanel(timeline=TIMELINE, state="collapsed")
            self._stream.send_blueprint(rrb.Blueprint(view, times))


def _entity(name: str) -> str:
    return rr.new_entity_path(["frames", name])


def _transform(link: ViewedLink, pose: NDArray[np.float64]) -> rr.Transform3D:
    return rr.Transform3D(
        translation=pose[:3],
        quaternion=rr.Quaternion(xyzw=pose[3:]),
        parent_frame=link.parent,
        child_frame=link.name,
    )


def _links_of(path: Path) -> frozenset[str]:
    try:
        robot = reader.read(path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from error
    return frozenset((robot.root, *(joint.child for joint in robot.joints)))


def _prefixes(robot: frozenset[str], frames: Iterable[str]) -> set[str]:
    """What stands before the names of the robot's links; "" or a text with a slash at its end."""
    links = ((frame, link_of(frame, robot)) for frame in frames)
    return {frame.removesuffix(link) for frame, link in links if link is not None}
