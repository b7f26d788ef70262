"""Looks pairs of frames up over time, in a mirror of a server or in a recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformException
from zenoh_tf_client.mirror.mirror import Mirror
from zenoh_tf_tools.viewer.live import LiveSource
from zenoh_tf_tools.viewer.placement import array_of
from zenoh_tf_tools.viewer.recorded import RecordedSource
from zenoh_tf_tools.viewer.source import Lookups, ViewedTree

#: (target, source)
Pair = tuple[str, str]

_PERIOD_S: Final = 0.02
#: Times at which a recording is asked.
_TIMES: Final = 2_000
_NO_POSE: Final = [float("nan")] * 7
_NO_VELOCITY: Final = [float("nan")] * 6


@dataclass(frozen=True)
class PairHistory:
    """What lookups of one pair answered, one row for each time.

    Attributes:
        target: The frame that the poses are in.
        source: The frame whose poses they are.
        stamps_ns: (n,) the times that were asked for; live, when was asked. Nanoseconds.
        poses: (n, 7) rows x, y, z in metres, qx, qy, qz, qw: `X_target_source`; NaN where a lookup
            had no answer.
        ages_s: (n,) how old the newest sample of the link was that had the oldest one, in seconds;
            NaN without an answer, and if all links are static.
        velocities: (n, 6) linear in m/s and angular in rad/s, of the source as seen from the
            target and in its axes; NaN without an answer. None if nobody asked.
        error: Why the last lookup without an answer had none; None if all had one.
    """

    target: str
    source: str
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    ages_s: NDArray[np.float64]
    velocities: NDArray[np.float64] | None
    error: TransformException | None

    @property
    def times_s(self) -> NDArray[np.float64]:
        """(n,) seconds since the first time."""
        since_first: NDArray[np.float64] = (self.stamps_ns - self.stamps_ns[0]) / 1e9
        return since_first

    @property
    def answered(self) -> NDArray[np.bool_]:
        """(n,) which lookups had an answer."""
        return ~np.isnan(self.poses[:, 0])


def pose_error(
    poses: NDArray[np.float64], reference: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far poses (n, 7) are from those of another pair at the same times, such as the
    truth: (n,) metres between the positions, and (n,) radians between the orientations, from 0 to
    pi; NaN where one of them is missing."""
    turns = (array_of(poses).inverse() @ array_of(reference)).rotations
    # An arc cosine would lose small angles.
    angles = 2 * np.arctan2(np.linalg.norm(turns[:, :3], axis=1), np.abs(turns[:, 3]))
    return np.linalg.norm(poses[:, :3] - reference[:, :3], axis=1), angles


#: A time, the pose, the age and the velocity then.
_Row = tuple[int, list[float], float, list[float]]


def _history(
    pair: Pair, rows: Sequence[_Row], error: TransformException | None, *, velocity: bool
) -> PairHistory:
    stamps_ns, poses, ages_s, velocities = (np.array(column) for column in zip(*rows, strict=True))
    # An interpolated age says nothing where there is no pose.
    ages_s[np.isnan(poses[:, 0])] = np.nan
    return PairHistory(*pair, stamps_ns, poses, ages_s, velocities if velocity else None, error)


def _velocity(lookups: Lookups, pair: Pair, stamp_ns: int | None) -> list[float]:
    """The velocity of a pair; None: at the latest common time."""
    target, source = pair
    try:
        found = lookups.lookup_velocity(source, target, stamp_ns)
    except TransformException:  # the pose fails, too, or a window at the begin is too early
        return _NO_VELOCITY
    return [*found.linear.tolist(), *found.angular.tolist()]


def follow(
    mirror: Mirror, pairs: Sequence[Pair], seconds: float, *, velocity: bool = False
) -> list[PairHistory]:
    """Look pairs up 50 times a second: the newest sample of each link.

    Args:
        mirror: The server's tree.
        pairs: Of target and source.
        seconds: For how long.
        velocity: Look their velocities up, too, at the latest common times.
    """
    live = LiveSource(mirror)
    rows: list[list[_Row]] = [[] for _ in pairs]
    errors: list[TransformException | None] = [None for _ in pairs]
    start_ns, start_s = time.time_ns(), time.monotonic()
    clock_ns, turns = 0, 0
    while (now_s := time.monotonic() - start_s) < seconds or not turns:
        for number, pair in enumerate(pairs):
            pose, age_s = _NO_POSE, float("nan")
            try:
                pose = [*mirror.lookup_latest_transform(*pair).transform.pose()]
                chain = mirror.chain(*pair)
                links = [link for name in chain if (link := live.link(name, clock_ns))]
                clock_ns = live.now_ns(links)
                age_s = _age_s(live, chain, clock_ns)
            except TransformException as error:
                errors[number] = error
            moved = _velocity(mirror, pair, None) if velocity else _NO_VELOCITY
            rows[number].append((start_ns + round(now_s * 1e9), pose, age_s, moved))
        turns += 1
        time.sleep(max(0.0, start_s + turns * _PERIOD_S - time.monotonic()))
    return [_history(*found, velocity=velocity) for found in zip(pairs, rows, errors, strict=True)]


def replayed(
    recording: RecordedSource,
    pairs: Sequence[Pair],
    range_ns: tuple[int, int],
    *,
    velocity: bool = False,
) -> list[PairHistory]:
    """Look pairs up at equally spaced times of a recording.

    Args:
        recording: The recording.
        pairs: Of target and source.
        range_ns: The first and the last time.
        velocity: Look their velocities up, too.
    """
    first_ns, last_ns = range_ns
    count = min(_TIMES, last_ns - first_ns + 1)
    # In whole numbers: a double is too coarse for nanoseconds since 1970, so that the last time
    # would lie behind the last sample.
    stamps_ns = [first_ns + (last_ns - first_ns) * i // max(count - 1, 1) for i in range(count)]
    found = []
    for pair in pairs:
        rows: list[_Row] = []
        last_error: TransformException | None = None
        answers = recording.lookups.lookup_transforms(*pair, np.array(stamps_ns, np.int64))
        for stamp_ns, pose in zip(stamps_ns, answers.poses.tolist(), strict=True):
            age_s = float("nan")
            try:
                age_s = _age_s(recording, recording.lookups.chain(*pair, stamp_ns), stamp_ns)
            except TransformException as error:
                last_error = error
            moved = _velocity(recording.lookups, pair, stamp_ns) if velocity else _NO_VELOCITY
            rows.append((stamp_ns, pose, age_s, moved))
        found.append(_history(pair, rows, last_error, velocity=velocity))
    return found


def _age_s(source: ViewedTree, chain: Sequence[str], time_ns: int) -> float:
    """The greatest age of the links between the frames of a chain; NaN if all are static."""
    links = [source.link(name, time_ns) for name in chain]
    ages = []
    for a, b in pairwise(links):
        if a is not None and b is not None:
            link = a if a.parent == b.name else b
            if link.age_s is not None:
                ages.append(link.age_s)
    return max(ages, default=float("nan"))
