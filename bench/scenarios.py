"""The robots whose estimates are judged: rates, delays and noise as in the field."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from bench.trajectories import Feed, drifting, driving, sampled, starting, swinging

Make = Callable[[np.random.Generator, float], list[Feed]]


def base_and_arm(rng: np.random.Generator, seconds: float) -> list[Feed]:
    """A corrected odometry and three joints at 200 Hz."""
    joints = (("shoulder", (0.2, 0.0, 0.5), 2, 1.5), ("elbow", (0.0, 0.0, 0.3), 1, 1.0))
    angle = partial(sampled, hz=200, late_s=0.005, jitter_s=0.001, lost=0.01, noise=(0, 2e-4))
    feeds, parent = driven(rng, seconds), "base"
    for child, offset, axis, most in (*joints, ("wrist", (0.4, 0.0, 0.0), 1, 1.0)):
        swing = swinging(rng, seconds, offset, axis, most)
        feeds.append(angle(rng, (parent, child), swing, seconds))
        parent = child
    return feeds


def arm(rng: np.random.Generator, seconds: float) -> list[Feed]:
    return base_and_arm(rng, seconds)[2:]


def driven(rng: np.random.Generator, seconds: float, clock_s: float = 0.0) -> list[Feed]:
    """A localiser at 10 Hz that is 80 ms late, and wheels at 50 Hz."""
    slow = partial(sampled, hz=10, late_s=0.08, jitter_s=0.02, noise=(0.003, 0.001))
    fast = partial(
        sampled, hz=50, late_s=0.02, jitter_s=0.003, lost=0.02, noise=(5e-4, 3e-4), clock_s=clock_s
    )
    drift = slow(rng, ("map", "odom"), drifting(rng, seconds), seconds)
    return [drift, fast(rng, ("odom", "base"), driving(rng, seconds), seconds)]


def link(
    hz: float, late_s: float, lost: float = 0.02, noise_m: float = 1e-3, **drive: float
) -> Make:
    def make(rng: np.random.Generator, seconds: float) -> list[Feed]:
        sample = partial(sampled, hz=hz, late_s=late_s, jitter_s=late_s / 4, lost=lost)
        motion = driving(rng, seconds, **drive)
        return [sample(rng, ("odom", "base"), motion, seconds, noise=(noise_m, noise_m / 2))]

    return make


SCENARIOS: dict[str, Make] = {
    "corrected odometry": driven,
    "arm on a base": base_and_arm,
    "arm": arm,
    "steady drive": link(30, 0.06, stops=0.0, acceleration=0.3),
    "sudden stops": link(20, 0.06, sudden=0.6),
    "long stops": link(20, 0.08, stops=0.5, stop_s=18.0),
    "camera": link(30, 0.1, lost=0.2, noise_m=3e-3, speed=0.5),
    "wireless": link(10, 0.36, lost=0.1),
}
AT_REST = "start after a rest"
LOSING: dict[str, Make] = {
    AT_REST: lambda rng, seconds: [
        sampled(
            rng, ("odom", "base"), starting(seconds), seconds, hz=20, late_s=0.08, noise=(1e-3, 0)
        )
    ],
    "clock 20 ms ahead": partial(driven, clock_s=0.02),
}
