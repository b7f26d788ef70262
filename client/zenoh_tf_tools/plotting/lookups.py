"""Looks pairs of frames up over time, in a mirror of a server or in a recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from zenoh_tf import TransformException
from zenoh_tf_client.mirror.mirror import Mirror
from zenoh_tf_tools.plotting.estimates import EstimateRows
from zenoh_tf_tools.plotting.pair import PairHistory
from zenoh_tf_tools.viewer.live import LiveSource
from zenoh_tf_tools.viewer.recorded import RecordedSource
from zenoh_tf_tools.viewer.source import Lookups, ViewedTree

#: (target, source)
Pair = tuple[str, str]

_PERIOD_S: Final = 0.02
#: After so many rows the samples are looked up that estimates are compared with.
_TURNS: Final = 100
#: Times at which a recording is asked.
_TIMES: Final = 2_000
_NO_POSE: Final = [float("nan")] * 7
_NO_VELOCITY: Final = [float("nan")] * 6


class _Rows:
    """The rows of a pair so far."""

    def __init__(self, pair: Pair, *, velocity: bool, estimate: bool = False) -> None:
        self.pair = pair
        self.estimates = EstimateRows(*pair) if estimate else None
        self._asks_velocity = velocity
        self._stamps_ns: list[int] = []
        self._poses: list[list[float]] = []
        self._ages_s: list[float] = []
        self._velocities: list[list[float]] = []
        self.error: TransformException | None = None

    def add(self, stamp_ns: int, pose: list[float], age_s: float) -> None:
        self._stamps_ns.append(stamp_ns)
        self._poses.append(pose)
        # An interpolated age says nothing where there is no pose.
        self._ages_s.append(float("nan") if np.isnan(pose[0]) else age_s)

    def add_velocity(self, lookups: Lookups, stamp_ns: int | None) -> None:
        """Look the velocity of the pair up, if it is wanted; None: at the latest common time."""
        if not self._asks_velocity:
            return
        target, source = self.pair
        try:
            found = lookups.lookup_velocity(source, target, stamp_ns)
        except TransformException:  # the pose fails, too, or a window at the begin is too early
            self._velocities.append(_NO_VELOCITY)
        else:
            self._velocities.append([*found.linear.tolist(), *found.angular.tolist()])

    def add_estimate(self, live: LiveSource, clock_ns: int) -> None:
        """Estimate the pose of the pair now, if that is wanted."""
        if self.estimates is not None:
            self.estimates.ask(partial(live.estimate, *self.pair, clock_ns), clock_ns)
            if len(self._stamps_ns) % _TURNS == 0:
                self.estimates.look_up(live.lookups)

    def history(self) -> PairHistory:
        velocities = np.array(self._velocities).reshape(-1, 6) if self._asks_velocity else None
        return PairHistory(
            *self.pair,
            np.array(self._stamps_ns, np.int64),
            np.array(self._poses).reshape(-1, 7),
            np.array(self._ages_s),
            velocities,
            self.error,
            None if self.estimates is None else self.estimates.history(),
        )


def follow(
    mirror: Mirror,
    pairs: Sequence[Pair],
    seconds: float,
    *,
    velocity: bool = False,
    estimate: bool = False,
) -> list[PairHistory]:
    """Look pairs up 50 times a second: the newest sample of each link.

    Args:
        mirror: The server's tree.
        pairs: Of target and source.
        seconds: For how long.
        velocity: Look their velocities up, too, at the latest common times.
        estimate: Estimate where they are, too.
    """
    live = LiveSource(mirror)
    rows = [_Rows(pair, velocity=velocity, estimate=estimate) for pair in pairs]
    start_ns, start_s = time.time_ns(), time.monotonic()
    clock_ns, turns = 0, 0
    while (now_s := time.monotonic() - start_s) < seconds or not turns:
        for each in rows:
            pose, age_s = _NO_POSE, float("nan")
            try:
                pose = [*mirror.lookup_latest_transform(*each.pair).transform.pose()]
                chain = mirror.chain(*each.pair)
                links = [link for name in chain if (link := live.link(name, clock_ns))]
                clock_ns = live.now_ns(links)
                age_s = _age_s(live, chain, clock_ns)
            except TransformException as error:
                each.error = error
            each.add(start_ns + round(now_s * 1e9), pose, age_s)
            each.add_velocity(mirror, None)
            each.add_estimate(live, clock_ns)
        turns += 1
        time.sleep(max(0.0, start_s + turns * _PERIOD_S - time.monotonic()))
    for each in rows:
        if each.estimates is not None:
            each.estimates.look_up(mirror)
    return [each.history() for each in rows]


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
        rows = _Rows(pair, velocity=velocity)
        answers = recording.lookups.lookup_transforms(*pair, np.array(stamps_ns, np.int64))
        for stamp_ns, pose in zip(stamps_ns, answers.poses.tolist(), strict=True):
            age_s = float("nan")
            try:
                age_s = _age_s(recording, recording.chain(*pair, stamp_ns), stamp_ns)
            except TransformException as error:
                rows.error = error
            rows.add(stamp_ns, pose, age_s)
            rows.add_velocity(recording.lookups, stamp_ns)
        found.append(rows.history())
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
