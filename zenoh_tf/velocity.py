"""How fast one frame moves in another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from zenoh_tf.errors import InvalidArgumentException

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True)
class Velocity:
    """The twist of the tracking frame as seen from the observation frame, which counts as
    standing still; expressed in the axes of the reference frame.

    It is the mean over ``[start_ns, end_ns]``, from the two poses at the ends: the displacement
    of the tracking frame's origin and the rotation vector from the one orientation to the other,
    each by the time between. A body that turns by half a turn or more in that time cannot be
    measured: shorten the averaging interval. Where links are interpolated, so is the velocity.

    Attributes:
        linear: (3,) float64, m/s: the velocity of the tracking body's point that is at the
            reference point at ``stamp_ns``. With ``p`` that point and ``o`` the tracking frame's
            origin it is the mean velocity of ``o`` plus ``angular x (p - o)``.
        angular: (3,) float64, rad/s: the same at every point of the body.
        stamp_ns: The time asked for, or the latest common time of tracking and observation
            frame; 0 where all links between them are static.
        start_ns, end_ns: The window: the averaging interval around ``stamp_ns``, moved back
            where it would end after the latest common time, cut off where it would begin
            before time zero. As in tf2; the linear part of
            tf2's result is another where a body turns.
        tracking_frame, observation_frame, reference_frame: As asked for.
    """

    linear: NDArray[np.float64]
    angular: NDArray[np.float64]
    stamp_ns: int
    start_ns: int
    end_ns: int
    tracking_frame: str
    observation_frame: str
    reference_frame: str

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Velocity:
        """From the native tree's record or a server's, whose vectors are lists."""
        values = {name: record[name] for name in cls.__slots__}
        for name in ("linear", "angular"):
            values[name] = np.array(values[name], np.float64).reshape(3)
            values[name].flags.writeable = False
        return cls(**values)


def interval_ns(averaging_interval_s: float) -> int:
    """An averaging interval in nanoseconds; ``InvalidArgumentException`` for one that is none."""
    if not 1e-9 <= averaging_interval_s <= 1e9:
        raise InvalidArgumentException(
            f"averaging_interval_s must be from 1e-9 to 1e9 seconds, not {averaging_interval_s!r}",
            field="averaging_interval_s",
        )
    return round(averaging_interval_s * 1e9)
