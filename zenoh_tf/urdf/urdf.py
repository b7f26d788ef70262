"""`Urdf`: a robot's links in a tree, from the positions of its joints."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from zenoh_tf import InvalidArgumentException, StampedTransform, Transform
from zenoh_tf.text import quoted
from zenoh_tf.text.similar import did_you_mean

from .kinematics import FrameNames, JointTransforms, fixed_transforms
from .reader import Joint, read


class _Tree(Protocol):
    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None: ...


class _Broadcaster(Protocol):
    def send(self, stampeds: Iterable[StampedTransform]) -> None: ...
    def send_static(self, stampeds: Iterable[StampedTransform]) -> None: ...


class Urdf:
    """A robot of a URDF file, whose links it publishes.

        arm = Urdf("arm.urdf", tree)
        arm.set_joints({"elbow": 0.3})

    From construction on all links of the robot are in the tree: the fixed ones as static links, the
    others with every joint at 0, or in the middle of its limits where 0 is outside of them. Each
    further call stores all joints that move at one stamp.

    Thread safety: one thread at a time.
    """

    def __init__(
        self,
        file: str | Path,
        target: _Tree | _Broadcaster,
        *,
        prefix: str = "",
        shared: Iterable[str] = (),
        authority: str = "urdf",
        stamp_ns: int | None = None,
    ) -> None:
        """Read the file, and publish all links.

        Args:
            file: URDF; expand xacro first. Meshes are not needed.
            target: A `TransformTree`; a client, whose server answers each call; or a client's
                broadcaster, which does not wait for an answer, publishes as its own authority, and
                gives the static links to a server that was restarted.
            prefix: Frames are named PREFIX/LINK; "": LINK.
            shared: Links that get no prefix, such as a map that several robots have.
            authority: Who publishes.
            stamp_ns: The time of the first positions in nanoseconds; None: now.

        Raises:
            InvalidArgumentException: The file is no URDF, or its joints are no tree; or the tree
                refuses a link.
            LimitExceeded: The file or the tree is too large.
            OSError: The file cannot be read.
        """
        self._robot = robot = read(Path(file))
        frame = FrameNames(prefix, shared)
        self._moves = JointTransforms(robot, frame)
        self._target = target
        self._authority = authority
        self._positions = {x.name: _begin(x) for x in self._moves.joints if x.mimic is None}
        self._own: dict[str, float] = {}  # of joints that mimic another, but were given
        if static := fixed_transforms(robot, frame):
            self._write(static, static=True)
        self._store(stamp_ns)

    @property
    def name(self) -> str:
        """The robot's name in the file."""
        return self._robot.name

    @property
    def root(self) -> str:
        """The link that is no joint's child, as the file names it."""
        return self._robot.root

    @property
    def warnings(self) -> tuple[str, ...]:
        """What of the file was left out, and why."""
        return self._robot.warnings

    @property
    def joints(self) -> list[str]:
        """The joints that `publish` takes positions of, in the order of the file: those that move
        and do not mimic another one."""
        return list(self._positions)

    @property
    def positions(self) -> dict[str, float]:
        """The positions that were stored last: radians; metres of sliding joints."""
        return self._positions | self._own

    def publish(self, q: ArrayLike, stamp_ns: int | None = None) -> None:
        """Store all joints, at one stamp.

        Args:
            q: (n,) positions of `joints`, in their order: radians; metres of sliding joints. A
                position beyond the joint's limits is stored as it is.
            stamp_ns: The time of the positions in nanoseconds; None: now.

        Raises:
            InvalidArgumentException: There are more or fewer, or one is NaN or infinite; `field`
                is its joint. Nothing is stored. Or the tree refuses them.
            ServerUnavailable: No server answers a client.
        """
        values = np.asarray(q, np.float64)
        if values.shape != (len(self._positions),):
            raise InvalidArgumentException(
                f"{self._label()} has {len(self._positions)} joints, but q has the shape "
                f"{values.shape}: see `joints`",
                field="q",
            )
        self.set_joints(dict(zip(self._positions, values.tolist(), strict=True)), stamp_ns)

    def set_joints(self, positions: Mapping[str, float], stamp_ns: int | None = None) -> None:
        """Store all joints, some of them with new positions, at one stamp.

        Args:
            positions: By the joint: radians; metres of sliding joints, stored as they are, also
                beyond the joint's limits. The others stay. A joint that mimics another may be
                given, and no longer mimics it then.
            stamp_ns: As of `publish`.

        Raises:
            InvalidArgumentException: A joint is unknown or does not move, or its position is no
                finite number; `field` is the joint. Nothing is stored. Or the tree refuses them.
            ServerUnavailable: No server answers a client.
        """
        for name, position in positions.items():
            self._check(name, position)
        before = self._positions, self._own
        mains = {k: float(v) for k, v in positions.items() if k in self._positions}
        self._positions = self._positions | mains
        self._own = self._own | {k: float(v) for k, v in positions.items() if k not in mains}
        try:
            self._store(stamp_ns)
        except BaseException:
            self._positions, self._own = before
            raise

    def _check(self, name: str, position: float) -> None:
        if not self._moves.moves(name):
            known = {joint.name: joint.kind for joint in self._robot.joints}
            if name in known:
                why = f"joint {quoted(name)} does not move: it is {known[name]}"
            else:
                names = [joint.name for joint in self._moves.joints]
                why = f"{self._label()} has no joint {quoted(name)}"
                if question := did_you_mean(name, names):
                    why += f"; {question}"
            raise InvalidArgumentException(why, field=name)
        if not math.isfinite(position):
            raise InvalidArgumentException(
                f"the position of joint {quoted(name)} is {position}", field=name
            )

    def _label(self) -> str:
        return f"robot {quoted(self._robot.name)}"

    def _store(self, stamp_ns: int | None) -> None:
        at = self.positions
        values = np.array(list(at.values()), np.float64)
        stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
        rows = self._moves.move(list(at), values, stamp_ns)
        links = [
            StampedTransform(rows.names[p], rows.names[c], stamp_ns, Transform.from_pose(pose))
            for p, c, pose in zip(rows.parent, rows.child, rows.pose, strict=True)
        ]
        if links:
            self._write(links, static=False)

    def _write(self, links: list[StampedTransform], *, static: bool) -> None:
        target = self._target
        if hasattr(target, "set_transforms_xact"):
            target.set_transforms_xact(links, self._authority, static)
        elif static:
            target.send_static(links)
        else:
            target.send(links)


def _begin(joint: Joint) -> float:
    """The first position: 0, or the middle of limits that leave it out."""
    if joint.lower <= 0 <= joint.upper:
        return 0.0
    return (joint.lower + joint.upper) / 2
