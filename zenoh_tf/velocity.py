"""How fast one frame moves in another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from zenoh_tf.errors import must_be

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True)
class Velocity:
    """The twist of the tracking frame relative to the observation frame, in the axes of the
    reference frame.

    It is the mean over the window, from the poses at its two ends: the displacement of the
    tracking frame's origin and the rotation vector between the two orientations, each divided by
    the window's length. A body must turn by less than half a turn in that time; otherwise shorten
    the averaging interval. Where links are interpolated, so is the velocity.

    Attributes:
        linear: (3,) float64, m/s: the velocity of the tracking body's point that is at the
            reference point at ``stamp_ns``. With ``p`` that point and ``o`` the tracking frame's
            origin it is the mean velocity of ``o`` plus ``angular x (p - o)``.
        angular: (3,) float64, rad/s: the same at every point of the body.
        stamp_ns: The requested time in nanoseconds, or the latest common time of tracking and
            observation frame; 0 if all links between them are static.
        start_ns: Start of the window in nanoseconds. The window is the averaging interval around
            ``stamp_ns``, moved back so that it ends by the latest common time and cut off at time
            zero. The window is tf2's; the linear part differs from tf2's for a body that turns.
        end_ns: End of the window in nanoseconds.
        tracking_frame: Frame whose motion this is.
        observation_frame: Frame that counts as standing still.
        reference_frame: Frame in whose axes the vectors are.
        gap_ns: The longest gap that a pose was interpolated over, in nanoseconds, as of
            `StampedTransform`; 0 if there is none. The velocity in a gap was not measured.
    """

    linear: NDArray[np.float64]
    angular: NDArray[np.float64]
    stamp_ns: int
    start_ns: int
    end_ns: int
    tracking_frame: str
    observation_frame: str
    reference_frame: str
    gap_ns: int = 0

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Velocity:
        """Return the instance of a map of the fields, whose vectors are lists.

        Args:
            record: Values by field name, from the native tree or a server.
        """
        values = {"gap_ns": 0} | {name: record[name] for name in cls.__slots__ if name in record}
        for name in ("linear", "angular"):
            values[name] = np.array(values[name], np.float64).reshape(3)
            values[name].flags.writeable = False
        return cls(**values)


def interval_ns(averaging_interval_s: float) -> int:
    """Return an averaging interval in nanoseconds. Raises InvalidArgumentException."""
    if not 1e-9 <= averaging_interval_s <= 1e9:
        raise must_be("averaging_interval_s", "from 1e-9 to 1e9 seconds", averaging_interval_s)
    return round(averaging_interval_s * 1e9)
