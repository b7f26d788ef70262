"""What estimates said of pairs of frames at times whose samples came later."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from zenoh_tf import Estimate, LimitExceeded, TransformException, TransformTree
from zenoh_tf.recordings import Message, Recording, RecordingError
from zenoh_tf.recordings.load import valid_commits
from zenoh_tf.text.times import CLOCK_RANGE_S, seconds
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.plotting.pair import (
    LEVEL,
    EstimateHistory,
    PairHistory,
    PoseError,
    pose_error,
)
from zenoh_tf_tools.viewer.source import Lookups

#: Rows that are looked up once more, as their samples may have come late.
_LATE: Final = 50
_NO_POSE: Final = [float("nan")] * 7
_NO_BOUNDS: Final = [float("nan")] * 2


class EstimateRows:
    """The estimates of a pair so far, one for each time, and what samples say of these times."""

    def __init__(self, target: str, source: str) -> None:
        self.pair = target, source
        self._stamps_ns: list[int] = []
        self._poses: list[list[float]] = []
        self._bounds: list[list[float]] = []
        self._truth: list[list[float]] = []

    def ask(self, estimate: Callable[[], Estimate | None], stamp_ns: int) -> None:
        """Add the estimate for a time.

        Args:
            estimate: Asks for it.
            stamp_ns: The time in nanoseconds, if there is no answer.
        """
        pose, bounds = _NO_POSE, _NO_BOUNDS
        with contextlib.suppress(TransformException):
            # Bounds of a lower level say less than those beside them.
            if (found := estimate()) is not None and found.level >= LEVEL:
                pose, bounds = [*found.transform.pose()], [found.error_m, found.error_rad]
                stamp_ns = found.stamp_ns
        self._stamps_ns.append(stamp_ns)
        self._poses.append(pose)
        self._bounds.append(bounds)

    def look_up(self, lookups: Lookups) -> None:
        """Look up what the samples say by now of the times since the last call, and shortly before
        it, as samples come late."""
        begin = max(0, len(self._truth) - _LATE)
        stamps_ns = np.array(self._stamps_ns[begin:], np.int64)
        self._truth[begin:] = lookups.lookup_transforms(*self.pair, stamps_ns).poses.tolist()

    def history(self) -> EstimateHistory:
        """Return all rows; `look_up` was called after the last of them."""
        poses, truth = (np.array(rows).reshape(-1, 7) for rows in (self._poses, self._truth))
        bounds = PoseError(*np.array(self._bounds).reshape(-1, 2).T)
        return EstimateHistory(poses, bounds, pose_error(poses, truth))


def foretold(
    recording: Recording, lookups: Lookups, histories: Sequence[PairHistory]
) -> list[PairHistory]:
    """Add what estimates say of the times of each pair from what had been recorded by then.

    Args:
        recording: The recording, which is read once more.
        lookups: All of it.
        histories: Pairs that were asked at the same times.

    Raises:
        CommandError: It is damaged, has too many frames, or its log is of another clock.
    """
    rows = [EstimateRows(history.target, history.source) for history in histories]
    stamps_ns = deque(histories[0].stamps_ns.tolist())
    tree = TransformTree()  # the last ten seconds, as a server keeps them

    def ask() -> None:
        stamp_ns = stamps_ns.popleft()
        for each in rows:
            each.ask(partial(tree.estimate_transform, *each.pair, stamp_ns), stamp_ns)

    try:
        for message in recording.messages():
            _check_clock(message)
            while stamps_ns and stamps_ns[0] < message.log_ns:
                ask()
            deque(valid_commits(recording, tree, message.rows, message.static), maxlen=0)
    except (RecordingError, LimitExceeded) as error:
        raise CommandError(str(error)) from error
    while stamps_ns:
        ask()
    for each in rows:
        each.look_up(lookups)
    return [
        replace(history, estimates=each.history())
        for history, each in zip(histories, rows, strict=True)
    ]


def _check_clock(message: Message) -> None:
    """Raise CommandError if a message's stamps cannot be compared with when it was recorded."""
    if message.static or not len(message.rows):
        return
    stamp_ns = int(message.rows.stamp.max())
    if abs(stamp_ns - message.log_ns) > CLOCK_RANGE_S * 10**9:
        raise CommandError(
            f"--estimate needs to know when samples came, but a transform with the stamp "
            f"{seconds(stamp_ns)} s was recorded at {seconds(message.log_ns)} s: the log is of "
            "another clock, as of simulated time"
        )
