"""Pose and age of one pair of frames over time."""

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
from zenoh_tf_tools.viewer.recorded import RecordedSource
from zenoh_tf_tools.viewer.source import ViewedTree

_PERIOD_S: Final = 0.02
#: Times at which a recording is asked.
_TIMES: Final = 2_000
_NO_POSE: Final = [float("nan")] * 7


@dataclass(frozen=True)
class PairHistory:
    """What lookups of one pair answered, one row for each time.

    Attributes:
        times_s: (n,) seconds since the first one.
        poses: (n, 7) rows x, y, z in metres, qx, qy, qz, qw: `X_target_source`; NaN where a lookup
            had no answer.
        ages_s: (n,) how old the newest sample of the link was that had the oldest one, in seconds;
            NaN without an answer, and if all links are static.
        error: Why the last lookup without an answer had none; None if all had one.
    """

    times_s: NDArray[np.float64]
    poses: NDArray[np.float64]
    ages_s: NDArray[np.float64]
    error: TransformException | None

    @property
    def answered(self) -> NDArray[np.bool_]:
        """(n,) which lookups had an answer."""
        return ~np.isnan(self.poses[:, 0])


def follow(mirror: Mirror, target: str, source: str, seconds: float) -> PairHistory:
    """Look a pair up 50 times a second: the newest sample of each link.

    Args:
        mirror: The server's tree.
        target: The frame to express the pose in.
        source: The frame whose pose is asked for.
        seconds: For how long.
    """
    live = LiveSource(mirror)
    times_s: list[float] = []
    poses: list[list[float]] = []
    ages_s: list[float] = []
    failure: TransformException | None = None
    start_s = time.monotonic()
    clock_ns = 0
    while (now_s := time.monotonic() - start_s) < seconds or not times_s:
        pose, age_s = _NO_POSE, float("nan")
        try:
            pose = [*mirror.lookup_latest_transform(target, source).transform.pose()]
            chain = mirror.chain(target, source)
            links = [link for name in chain if (link := live.link(name, clock_ns))]
            clock_ns = live.now_ns(links)
            age_s = _age_s(live, chain, clock_ns)
        except TransformException as error:
            failure = error
        times_s.append(now_s)
        poses.append(pose)
        ages_s.append(age_s)
        time.sleep(max(0.0, start_s + len(times_s) * _PERIOD_S - time.monotonic()))
    return _history(times_s, poses, ages_s, failure)


def replayed(recording: RecordedSource, target: str, source: str) -> PairHistory:
    """Look a pair up at times of a recording, from its first sample to its last.

    Args:
        recording: The recording.
        target: The frame to express the pose in.
        source: The frame whose pose is asked for.
    """
    first_ns, last_ns = recording.range_ns
    stamps_ns = np.linspace(first_ns, last_ns, _TIMES if last_ns > first_ns else 1).astype(np.int64)
    answers = recording.lookups.lookup_transforms(target, source, stamps_ns)
    ages_s = []
    failure: TransformException | None = None
    for stamp_ns in stamps_ns.tolist():
        age_s = float("nan")
        try:
            chain = recording.chain(target, source, stamp_ns)
            age_s = _age_s(recording, chain, stamp_ns)
        except TransformException as error:
            failure = error
        ages_s.append(age_s)
    times_s = (stamps_ns - first_ns) / 1e9
    return _history(times_s.tolist(), answers.poses.tolist(), ages_s, failure)


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


def _history(
    times_s: list[float],
    poses: list[list[float]],
    ages_s: list[float],
    failure: TransformException | None,
) -> PairHistory:
    rows = np.array(poses).reshape(-1, 7)
    ages = np.where(np.isnan(rows[:, 0]), np.nan, np.array(ages_s))
    return PairHistory(np.array(times_s), rows, ages, failure)
