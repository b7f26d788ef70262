"""What the poses of a link say: jumps, frozen poses, wobbling mounts and millimetres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zenoh_tf_tools.doctor.timing import Chunk

Floats = NDArray[np.float64]

#: A jump: farther than this, and than so many times what the link does otherwise.
_JUMP_M: Final = 1.0
_JUMP_RAD: Final = 1.0
_JUMP_TIMES: Final = 5.0
#: Steps that show what a link does otherwise; without the largest, as one wrong pose is two jumps.
_LEAST_STEPS: Final = 8
_LARGEST: Final = 4
#: A stray pose of a joint: the poses around it are alike to this part of the way to it.
_RETURNED: Final = 0.2
#: Lengths that grow so many times were metres and are millimetres.
_MILLI: Final = (700.0, 1400.0)
_MILLI_FROM_M: Final = 0.05
#: Over which a speed is measured.
_WHILE_NS: Final = 200_000_000
#: A frozen pose: the same for so long and so many samples, after steps that were this fast.
_FROZEN_S: Final = 1.0
_FROZEN_STEPS: Final = 10
_MOVING_M_S: Final = 0.02
_MOVING_RAD_S: Final = 0.05
_ABRUPT: Final = 0.5
_WOBBLE_SAMPLES: Final = 20


class Jump(NamedTuple):
    """A step that the link's other ones do not explain."""

    stamp_ns: int
    shift_m: float
    turn_rad: float
    took_s: float
    usual_m_s: float  # the link's speed otherwise, at most
    is_milli: bool  # the lengths grew or shrank a thousand times


class Freeze(NamedTuple):
    """A time in which the pose was the same, to the last bit, after it had moved."""

    start_ns: int  # stamps
    end_ns: int
    samples: int
    speed_m_s: float  # before
    speed_rad_s: float


@dataclass(slots=True)
class Motion:
    """What is known of a link's poses.

    Attributes:
        jump: The first jump.
        jumps: How many there were.
        freeze: The longest time with a frozen pose.
        moved_ns: The last stamp at which the pose was another one than before.
        still_part: The part of the steps that did not move at all.
        speed_m_s: The median speed while it moved, at most of all times.
        wobble_m: How far the child was from its median position, in 95 of 100 samples.
        distance_m: The median distance of child and parent.
    """

    jump: Jump | None = None
    jumps: int = 0
    freeze: Freeze | None = None
    moved_ns: int | None = None
    still_part: float = 0.0
    speed_m_s: float = 0.0
    wobble_m: float = 0.0
    distance_m: float | None = None

    def read(self, chunk: Chunk) -> None:
        """Add what a chunk says.

        Args:
            chunk: The samples.
        """
        order = np.argsort(chunk.stamps, kind="stable")
        stamps = chunk.stamps[order]
        order = order[np.append(stamps[1:] != stamps[:-1], True)]
        stamps, poses = chunk.stamps[order], chunk.poses[order]
        self.distance_m = float(np.median(np.linalg.norm(poses[:, :3], axis=1)))
        if len(stamps) <= _LEAST_STEPS:
            return
        steps = _Steps.of(stamps, poses)
        self.still_part = 1.0 - float(np.mean(steps.moved))
        if steps.moved.any():
            self.moved_ns = int(stamps[1:][steps.moved][-1])
            self.speed_m_s = max(self.speed_m_s, _travel_m_s(stamps, poses, steps.moved))
        self._find_jumps(steps, poses, order[1:] >= chunk.fresh)
        self._find_freeze(steps)
        if len(stamps) >= _WOBBLE_SAMPLES:
            away = np.linalg.norm(poses[:, :3] - np.median(poses[:, :3], axis=0), axis=1)
            self.wobble_m = max(self.wobble_m, float(np.quantile(away, 0.95)))

    def _find_jumps(self, steps: _Steps, poses: Floats, fresh: NDArray[np.bool_]) -> None:
        usual_m_s = _usual(steps.speed_m_s)
        far = steps.shift_m > np.maximum(_JUMP_M, _JUMP_TIMES * usual_m_s * steps.took_s)
        if (poses[:, :3] == poses[0, :3]).all():  # a joint or a wheel that turns
            far |= _strays(steps, poses)
        else:
            usual_rad_s = _usual(steps.speed_rad_s)
            far |= steps.turn_rad > np.maximum(_JUMP_RAD, _JUMP_TIMES * usual_rad_s * steps.took_s)
        found = np.flatnonzero(far & fresh)
        self.jumps += len(found)
        if self.jump is not None or not len(found):
            return
        i = int(found[0])
        before, after = np.linalg.norm(poses[i : i + 2, :3], axis=1)
        ratio = max(before, after) / max(min(before, after), 1e-9)
        self.jump = Jump(
            int(steps.end_ns[i]),
            float(steps.shift_m[i]),
            float(steps.turn_rad[i]),
            float(steps.took_s[i]),
            usual_m_s,
            bool(_MILLI[0] < ratio < _MILLI[1] and min(before, after) > _MILLI_FROM_M),
        )

    def _find_freeze(self, steps: _Steps) -> None:
        still = np.concatenate([[False], ~steps.moved, [False]])
        edges = np.flatnonzero(np.diff(still.astype(np.int8)))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            found = _freeze(steps, begin, end)
            longest = self.freeze
            if found is not None and (longest is None or found.samples > longest.samples):
                self.freeze = found


class _Steps(NamedTuple):
    """The steps between successive stamps."""

    end_ns: NDArray[np.int64]
    took_s: Floats
    shift_m: Floats
    turn_rad: Floats
    moved: NDArray[np.bool_]  # the pose is another one, by a bit at least

    @classmethod
    def of(cls, stamps: NDArray[np.int64], poses: Floats) -> _Steps:
        return cls(
            stamps[1:],
            np.diff(stamps) / 1e9,
            np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1),
            _turn_rad(poses[1:], poses[:-1]),
            (poses[1:] != poses[:-1]).any(axis=1),
        )

    @property
    def speed_m_s(self) -> Floats:
        speed: Floats = self.shift_m / self.took_s
        return speed

    @property
    def speed_rad_s(self) -> Floats:
        speed: Floats = self.turn_rad / self.took_s
        return speed


def _travel_m_s(stamps: NDArray[np.int64], poses: Floats, moved: NDArray[np.bool_]) -> float:
    """The median speed from each step that moves over a while, as a pose may swing to and fro."""
    begin = np.flatnonzero(moved)
    end = np.searchsorted(stamps, stamps[begin] + _WHILE_NS)
    begin, end = begin[end < len(stamps)], end[end < len(stamps)]
    if len(begin) < _LEAST_STEPS:
        return 0.0
    way_m = np.linalg.norm(poses[end, :3] - poses[begin, :3], axis=1)
    return float(np.median(way_m / (stamps[end] - stamps[begin]) * 1e9))


def _strays(steps: _Steps, poses: Floats) -> NDArray[np.bool_]:
    """Which steps lead to one pose far from those before and after it, which are alike: what a
    driver sends between two measurements. A wheel that turns fast does not come back."""
    far = steps.turn_rad > max(_JUMP_RAD, _JUMP_TIMES * float(np.quantile(steps.turn_rad, 0.9)))
    across = _turn_rad(poses[2:], poses[:-2])
    stray = far[:-1] & far[1:] & (across < _RETURNED * steps.turn_rad[:-1])
    return np.append(stray, False)


def _turn_rad(poses: Floats, others: Floats) -> Floats:
    """The angle between the rotations of each two poses."""
    angle: Floats = np.einsum("ij,ij->i", poses[:, 3:], others[:, 3:])
    return 2 * np.arccos(np.minimum(np.abs(angle), 1.0))


def _usual(speeds: Floats) -> float:
    """The greatest speed but for a few."""
    skipped = min(_LARGEST, len(speeds) // 4)
    return float(np.sort(speeds)[-1 - skipped])


def _freeze(steps: _Steps, begin: int, end: int) -> Freeze | None:
    """The still steps from `begin` to `end` as a freeze. None: a robot stops more gently, and goes
    on from where it has stopped."""
    took_s = float(steps.took_s[begin:end].sum())
    if took_s < _FROZEN_S or end - begin < _FROZEN_STEPS or begin < _FROZEN_STEPS:
        return None
    before = slice(begin - _FROZEN_STEPS, begin)
    if np.count_nonzero(steps.moved[before]) < _FROZEN_STEPS - 1:
        return None
    metres, radians = steps.speed_m_s[before], steps.speed_rad_s[before]
    usual_m_s, usual_rad_s = float(np.median(metres)), float(np.median(radians))
    abrupt = (usual_m_s > _MOVING_M_S and metres[-1] > _ABRUPT * usual_m_s) or (
        usual_rad_s > _MOVING_RAD_S and radians[-1] > _ABRUPT * usual_rad_s
    )
    if not abrupt:
        return None
    if end < len(steps.moved) and steps.shift_m[end] < _JUMP_TIMES * np.median(
        steps.shift_m[before]
    ):
        return None
    start_ns = int(steps.end_ns[begin] - round(steps.took_s[begin] * 1e9))
    return Freeze(start_ns, int(steps.end_ns[end - 1]), end - begin, usual_m_s, usual_rad_s)
