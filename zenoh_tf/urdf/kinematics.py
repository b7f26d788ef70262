"""Turns positions of joints into transforms, all joints of a message at once.

A joint turns or slides along its axis, so that its pose in the parent is a fixed function of one
number q. With the origin (t, r) and the axis a, r as a quaternion and (a, 0) as one, too:

    revolute, continuous   t                    r sin(q/2) (a, 0) + r cos(q/2)
    prismatic              t + q R a            r

So each joint has three constant rows: R a for a sliding one, r (a, 0) for a turning one, and r.

Thread safety: `JointTransforms` is used by one thread at a time.
"""

from __future__ import annotations

import functools
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import StampedTransform
from zenoh_tf._core import TransformRows

from .reader import MOVING, Joint, Robot

#: Sets of joint names that are remembered: a robot has one for each of its controllers.
_MAX_PLANS: Final = 64


class FrameNames:
    """Names the frame of a link: PREFIX/LINK, or LINK alone without a prefix.

    A link that is shared by several robots, or has the prefix already, keeps its name.
    """

    def __init__(self, prefix: str = "", shared: Iterable[str] = ()) -> None:
        self._prefix = prefix.strip("/") + "/" if prefix.strip("/") else ""
        self._shared = frozenset(shared)

    def __call__(self, link: str) -> str:
        """Return the name of a link's frame."""
        return (
            link if link in self._shared or link.startswith(self._prefix) else self._prefix + link
        )


def link_of(frame: str, links: Container[str]) -> str | None:
    """Return the link that a frame is named after, with any prefix; None if it is none of these.

    A robot's prefix ends with a slash, but a link's own name may have some, too: the longest fits.
    """
    parts = frame.split("/")
    names = ("/".join(parts[start:]) for start in range(len(parts)))
    return next((name for name in names if name in links), None)


#: No prefix.
AS_IN_URDF: Final = FrameNames()


@dataclass(slots=True)
class JointCounts:
    """What was left out or is doubtful."""

    transforms: int = 0
    unknown_joints: int = 0  # names that the robot has not
    not_numbers: int = 0  # positions that are NaN or infinite, which are not used
    beyond_limits: int = 0  # positions outside of the joint's limits; published all the same


@dataclass(frozen=True, slots=True)
class _Plan:
    """What the joints of a message move."""

    row: NDArray[np.intp]  # (n,) the joints that move
    source: NDArray[np.intp]  # (n,) the position in the message that moves each of them
    multiplier: NDArray[np.float64]  # (n,)
    offset: NDArray[np.float64]  # (n,)
    unknown: list[str]
    names: list[str]
    parent: NDArray[np.uint32]
    child: NDArray[np.uint32]


class JointTransforms:
    """The moving joints of a robot."""

    def __init__(self, robot: Robot, frame: FrameNames = AS_IN_URDF) -> None:
        self._joints = robot.of_kind(*MOVING)
        self._order = _leaders_first(self._joints)
        self._known = {joint.name for joint in robot.joints}
        self._moving = {joint.name for joint in self._joints}
        self._frame = frame
        self._plan = functools.lru_cache(_MAX_PLANS)(self._make_plan)
        self.counts = JointCounts()
        #: The first joint that was counted, by the name of the counter.
        self.first: dict[str, str] = {}
        turns = np.array([joint.kind != "prismatic" for joint in self._joints], bool)
        self._half_turn = np.where(turns, 0.5, 0.0)
        self._slide = np.where(turns, 0.0, 1.0)
        self._lower = np.array([joint.lower for joint in self._joints])
        self._upper = np.array([joint.upper for joint in self._joints])
        origins = [joint.origin for joint in self._joints]
        axes = [joint.axis for joint in self._joints]
        self._origin = np.reshape([X.translation for X in origins], (-1, 3))
        self._rotation = np.reshape([X.rotation for X in origins], (-1, 4))
        self._direction = np.reshape(
            [X.apply_vectors(axis) for X, axis in zip(origins, axes, strict=True)], (-1, 3)
        )
        self._turned = np.reshape(
            [_times_axis(X.rotation, axis) for X, axis in zip(origins, axes, strict=True)], (-1, 4)
        )

    @property
    def joints(self) -> Sequence[Joint]:
        """The joints that a position moves."""
        return self._joints

    def moves(self, name: str) -> bool:
        """True if a joint of this name is moved by a position."""
        return name in self._moving

    def move(
        self, names: Sequence[str], positions: NDArray[np.float64], stamp_ns: int
    ) -> TransformRows:
        """Return the transforms of the joints of one message, and of those that mimic them.

        Args:
            names: (n,) joints. Unknown ones are counted and left out. Of a name that is there
                twice the last one counts.
            positions: (n,) radians; metres of sliding joints.
            stamp_ns: The time of the message in nanoseconds.

        Returns:
            A row for each joint that moves. A joint that mimics another has the position that the
            message gives for itself, if it does and that is a number.
        """
        usable = np.isfinite(positions)
        if not usable.all():
            bad = [name for name, ok in zip(names, usable, strict=True) if not ok]
            self._count("not_numbers", [name for name in bad if name in self._moving])
            names = [name for name, ok in zip(names, usable, strict=True) if ok]
            positions = positions[usable]
        plan = self._plan(tuple(names))
        counts = self.counts
        self._count("unknown_joints", plan.unknown)
        row = plan.row
        with np.errstate(over="ignore", invalid="ignore"):
            value = plan.multiplier * positions[plan.source] + plan.offset
        names_, parent, child = plan.names, plan.parent, plan.child
        finite = np.isfinite(value)
        if not finite.all():
            self._count("not_numbers", self._names(row[~finite]))
            row, value = row[finite], value[finite]
            names_, parent, child = self._columns(row)
        outside = (value < self._lower[row]) | (value > self._upper[row])
        if outside.any():
            self._count("beyond_limits", self._names(row[outside]))
        counts.transforms += value.size
        half = (value * self._half_turn[row])[:, None]
        pose = np.empty((value.size, 7))
        pose[:, :3] = self._origin[row] + (value * self._slide[row])[:, None] * self._direction[row]
        pose[:, 3:] = self._turned[row] * np.sin(half) + self._rotation[row] * np.cos(half)
        return TransformRows(names_, parent, child, np.full(value.size, stamp_ns, np.int64), pose)

    def _count(self, counter: str, joints: Sequence[str]) -> None:
        if joints:
            setattr(self.counts, counter, getattr(self.counts, counter) + len(joints))
            self.first.setdefault(counter, joints[0])

    def _names(self, rows: NDArray[np.intp]) -> list[str]:
        return [self._joints[row].name for row in rows]

    def _make_plan(self, names: tuple[str, ...]) -> _Plan:
        place = {name: at for at, name in enumerate(names)}
        # By the joint: the position in the message that moves it, and the factor and the offset.
        moved: dict[str, tuple[int, float, float]] = {}
        for row in self._order:
            joint = self._joints[row]
            mimic = joint.mimic
            if joint.name in place:
                moved[joint.name] = (place[joint.name], 1.0, 0.0)
            elif mimic is not None and mimic.joint in moved:
                source, multiplier, offset = moved[mimic.joint]
                m = mimic.multiplier  # m * (multiplier * q + offset) + mimic.offset
                moved[joint.name] = (source, m * multiplier, m * offset + mimic.offset)
        rows = [row for row, joint in enumerate(self._joints) if joint.name in moved]
        found = [moved[self._joints[row].name] for row in rows]
        at = np.array(rows, np.intp)
        return _Plan(
            at,
            np.array([source for source, _, _ in found], np.intp),
            np.array([multiplier for _, multiplier, _ in found], np.float64),
            np.array([offset for _, _, offset in found], np.float64),
            [name for name in names if name not in self._known],
            *self._columns(at),
        )

    def _columns(
        self, rows: NDArray[np.intp]
    ) -> tuple[list[str], NDArray[np.uint32], NDArray[np.uint32]]:
        """The names of the frames of some joints, and the indexes of parents and children."""
        index: dict[str, int] = {}
        ends = [
            [index.setdefault(self._frame(link), len(index)) for link in (j.parent, j.child)]
            for j in (self._joints[row] for row in rows)
        ]
        columns = np.array(ends, np.uint32).reshape(-1, 2)
        return list(index), columns[:, 0].copy(), columns[:, 1].copy()


def _leaders_first(joints: Sequence[Joint]) -> list[int]:
    """The rows of joints, each after that of the joint that it mimics."""
    row_of = {joint.name: row for row, joint in enumerate(joints)}
    order: dict[int, None] = {}
    for row in range(len(joints)):
        path = []
        each: int | None = row
        while each is not None and each not in order:
            path.append(each)
            mimic = joints[each].mimic
            each = None if mimic is None else row_of[mimic.joint]
        order.update(dict.fromkeys(reversed(path)))
    return list(order)


def fixed_transforms(robot: Robot, frame: FrameNames = AS_IN_URDF) -> list[StampedTransform]:
    """The transforms of the joints that do not move, in the order of the file, stamped 0."""
    return [
        StampedTransform(frame(joint.parent), frame(joint.child), 0, joint.origin)
        for joint in robot.of_kind("fixed")
    ]


def _times_axis(rotation: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """The product of the quaternions `rotation` and (axis, 0)."""
    vector, w = rotation[:3], rotation[3]
    return np.array([*(w * axis + np.cross(vector, axis)), -vector @ axis])
