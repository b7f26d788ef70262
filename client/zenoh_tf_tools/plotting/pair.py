"""Pose, age, velocity and estimates of a pair of frames over time, and errors of poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformException
from zenoh_tf_tools.viewer.placement import array_of

#: Share of the estimates whose errors are within the bounds.
LEVEL: Final = 0.9


@dataclass(frozen=True)
class PoseError:
    """How far poses are from others at the same times, or may be.

    Attributes:
        distances_m: (n,) between the positions; NaN where there is no pose.
        angles_rad: (n,) of the rotation between the two orientations, from 0 to pi.
    """

    distances_m: NDArray[np.float64]
    angles_rad: NDArray[np.float64]


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
        estimates: What was estimated for each time before its samples came. None if nobody asked.
    """

    target: str
    source: str
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    ages_s: NDArray[np.float64]
    velocities: NDArray[np.float64] | None
    error: TransformException | None
    estimates: EstimateHistory | None = None

    @property
    def times_s(self) -> NDArray[np.float64]:
        """(n,) seconds since the first time."""
        since_first: NDArray[np.float64] = (self.stamps_ns - self.stamps_ns[0]) / 1e9
        return since_first

    @property
    def answered(self) -> NDArray[np.bool_]:
        """(n,) which lookups had an answer."""
        return ~np.isnan(self.poses[:, 0])


@dataclass(frozen=True)
class EstimateHistory:
    """What was estimated for each time before its samples came, and how wrong that was.

    Attributes:
        poses: (n, 7) rows as of lookups: `X_target_source`; NaN without an estimate.
        bounds: How wrong they may be: NaN without an estimate.
        errors: How wrong they were, by the samples; NaN where these said nothing.
    """

    poses: NDArray[np.float64]
    bounds: PoseError
    errors: PoseError

    @property
    def compared(self) -> NDArray[np.bool_]:
        """(n,) which estimates are known to be right or wrong."""
        return ~np.isnan(self.bounds.distances_m + self.errors.distances_m)

    @property
    def within(self) -> NDArray[np.bool_]:
        """(n,) which errors were within both bounds."""
        within: NDArray[np.bool_] = (self.errors.distances_m <= self.bounds.distances_m) & (
            self.errors.angles_rad <= self.bounds.angles_rad
        )
        return within


def pose_error(poses: NDArray[np.float64], reference: NDArray[np.float64]) -> PoseError:
    """Return how far poses are from others.

    Args:
        poses: (n, 7) rows as of `PairHistory`, such as estimates.
        reference: (n, 7) what they are compared with, such as the truth.
    """
    turns = (array_of(poses).inverse() @ array_of(reference)).rotations
    # An arc cosine would lose small angles.
    angles = 2 * np.arctan2(np.linalg.norm(turns[:, :3], axis=1), np.abs(turns[:, 3]))
    return PoseError(np.linalg.norm(poses[:, :3] - reference[:, :3], axis=1), angles)
