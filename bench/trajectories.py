"""Simulated robots whose pose is known exactly at any time, and their samples as a tree gets them:
late, jittered, noisy and with gaps. Rates, delays and noise are as in the field."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from zenoh_tf import StampedTransform, Transform, TransformArray, TransformTree

Array = NDArray[np.float64]
#: Poses of a child in its parent, (n, 7), at times in seconds, (n,).
Motion = Callable[[Array], Array]
STEP_S = 0.005
#: How often a base starts that rests most of the time.
STARTS_EVERY_S = 18.0
#: Of the tool.
MOUNT = Transform((0.3, 0, 0.4))


@dataclass(frozen=True)
class Feed:
    """The samples of one link, in the order of their stamps."""

    parent: str
    child: str
    motion: Motion
    stamps_s: Array
    arrivals_s: Array
    poses: Array

    def newest(self, times_s: Array) -> NDArray[np.int64]:
        """At each time the row of the newest sample that has arrived."""
        order = np.argsort(self.arrivals_s, kind="stable")
        arrived = np.searchsorted(self.arrivals_s[order], times_s, "right") - 1
        return np.asarray(np.maximum.accumulate(order)[np.maximum(arrived, 0)])

    def carried(self, times_s: Array, twist: bool) -> TransformArray:
        """What is usual without `estimate_transform`: the newest pose, or that pose carried on by
        the velocity between the last two samples."""
        now = self.newest(times_s)
        poses = self.poses[now]
        if twist:
            before = np.maximum(now - 1, 0)
            step_s = np.maximum(self.stamps_s[now] - self.stamps_s[before], 1e-9)
            share = ((times_s - self.stamps_s[now]) / step_s)[:, None]
            turn = share * _turns(self.poses[before], poses).as_rotvec()
            poses[:, :3] += share * (poses[:, :3] - self.poses[before, :3])
            poses[:, 3:] = _turned(poses, turn)
        return _array(poses)


class Scenario:
    """A robot: the links from a target to a source, in order. The last one is static."""

    def __init__(self, name: str, feeds: list[Feed]) -> None:
        self.name, self.feeds = name, feeds
        #: Target and source.
        self.ends = feeds[0].parent, "tool"
        arrivals_s = np.concatenate([feed.arrivals_s for feed in feeds])
        order = np.argsort(arrivals_s, kind="stable")
        samples = [
            StampedTransform(feed.parent, feed.child, stamp, Transform(pose[:3], pose[3:]))
            for feed in feeds
            for stamp, pose in zip(nanoseconds(feed.stamps_s), feed.poses, strict=True)
        ]
        self._arrivals_s, self._samples = arrivals_s[order], [samples[i] for i in order]

    def prepare(self, cache_time_s: float) -> TransformTree:
        """An empty tree for `feed`."""
        tree = TransformTree(cache_time_s=cache_time_s, max_samples_per_frame=1 << 20)
        tree.set_transform(StampedTransform(self.feeds[-1].child, "tool", 0, MOUNT), static=True)
        self._fed = 0
        return tree

    def feed(self, tree: TransformTree, until_s: float) -> None:
        """Store what arrives by a time."""
        end = int(np.searchsorted(self._arrivals_s, until_s, "right"))
        if end > self._fed:
            tree.set_transforms_xact(self._samples[self._fed : end])
        self._fed = end

    def truth(self, times_s: Array) -> Array:
        """The exact poses of source in target."""
        return self._chain([_array(feed.motion(times_s)) for feed in self.feeds])

    def carried(self, times_s: Array, twist: bool) -> Array:
        """See `Feed.carried`."""
        return self._chain([feed.carried(times_s, twist) for feed in self.feeds])

    def _chain(self, links: list[TransformArray]) -> Array:
        return (reduce(lambda a, b: a @ b, links) @ MOUNT).poses


def nanoseconds(times_s: Array) -> list[int]:
    """Stamps from seconds."""
    found: list[int] = np.round(times_s * 1e9).astype(np.int64).tolist()
    return found


def errors(found: Array, truth: Array) -> tuple[Array, Array]:
    """Metres and radians between poses, row by row."""
    metres = np.linalg.norm(found[:, :3] - truth[:, :3], axis=1)
    return metres, _turns(truth, found).magnitude()


def driving(
    rng: np.random.Generator,
    seconds: float,
    speed: float = 1.0,
    acceleration: float = 1.0,
    stops: float = 0.3,
    stop_s: float = 3.0,
    sudden: float = 0.0,
) -> Motion:
    """A base in a hall: segments of constant speed and turn rate, which it reaches with a limited
    acceleration (m/s2, twice that in rad/s2). 10 m from the middle it turns back. `stops` is the
    share of segments in which it stands, `sudden` of those that begin as if it hit something."""
    count, end = int(seconds / STEP_S) + 2, 0
    places = np.zeros((count, 3))
    x = y = heading = forward = turn = 0.0
    for i in range(count):
        if i >= end:
            stands, gain = rng.random() < stops, 20 if rng.random() < sudden else 1
            lasts_s = rng.uniform(1, stop_s) if stands else rng.uniform(1.5, 6)
            wanted = 0.0 if stands else speed * rng.uniform(0.2, 1)
            curve = 0.0 if stands or rng.random() < 0.4 else rng.uniform(-1, 1)
            end, most = i + int(lasts_s / STEP_S), acceleration * gain * STEP_S
        if wanted and x * x + y * y > 100:
            home = math.remainder(math.atan2(-y, -x) - heading, math.tau)
            curve = min(1.0, max(-1.0, home))
        forward += min(most, max(-most, wanted - forward))
        turn += min(2 * most, max(-2 * most, curve - turn))
        heading += turn * STEP_S
        x, y = x + forward * math.cos(heading) * STEP_S, y + forward * math.sin(heading) * STEP_S
        places[i] = x, y, heading
    return _in_plane(places)


def starting(seconds: float) -> Motion:
    """A base that rests and, every `STARTS_EVERY_S`, drives for the last 3 s of that time, with
    1 m/s2 to 1 m/s and back."""
    phase = np.arange(0, seconds + STEP_S, STEP_S) % STARTS_EVERY_S - (STARTS_EVERY_S - 3)
    speed = np.clip(np.minimum(phase, 3 - phase), 0, 1)
    return _in_plane(np.stack([np.cumsum(speed) * STEP_S, 0 * speed, 0 * speed], axis=1))


def drifting(rng: np.random.Generator, seconds: float) -> Motion:
    """The correction of odometry: a smooth random walk in the plane, some millimetres a second."""
    steps = rng.normal(size=(int(seconds / STEP_S) + 200, 3)) * [6e-4, 6e-4, 2e-4]
    walk = np.cumsum(steps, axis=0)
    smooth = [np.convolve(column, np.ones(100) / 100, "valid") for column in walk.T]
    return _in_plane(np.array(smooth).T)


def swinging(
    rng: np.random.Generator, seconds: float, offset: tuple[float, ...], axis: int, most: float
) -> Motion:
    """A joint that moves from angle to angle in 0.6 to 1.5 s, with a smooth start and end, and
    rests for up to a second."""
    angles, angle = [np.zeros(1)], 0.0
    left = int(seconds / STEP_S) + 2
    while left > 0:
        to, steps = rng.uniform(-most, most), int(rng.uniform(0.6, 1.5) / STEP_S)
        s = np.arange(1, steps + 1) / steps
        angles.append(angle + (to - angle) * (10 * s**3 - 15 * s**4 + 6 * s**5))
        angles.append(np.full(int(rng.uniform(0, 1) / STEP_S), to))
        left -= len(angles[-1]) + len(angles[-2])
        angle = to
    path = np.concatenate(angles)

    def motion(times_s: Array) -> Array:
        half = np.interp(times_s, np.arange(len(path)) * STEP_S, path) / 2
        poses = np.tile([*offset, 0.0, 0.0, 0.0, 0.0], (len(half), 1))
        poses[:, 3 + axis], poses[:, 6] = np.sin(half), np.cos(half)
        return np.asarray(poses)

    return motion


def sampled(
    rng: np.random.Generator,
    names: tuple[str, str],
    motion: Motion,
    seconds: float,
    *,
    hz: float,
    late_s: float,
    jitter_s: float = 0.0,
    lost: float = 0.0,
    noise: tuple[float, float] = (0.0, 0.0),
    clock_s: float = 0.0,
) -> Feed:
    """Samples of a link: each arrives `late_s` after it was measured and a random time of mean
    `jitter_s` later; a share is lost; noise is in metres and radians, and `clock_s` is by how much
    the clock that stamps them is ahead."""
    times_s = np.arange(rng.uniform(0, 1 / hz), seconds, 1 / hz)
    times_s = times_s[rng.random(len(times_s)) >= lost]
    count, poses = len(times_s), motion(times_s)
    poses[:, :3] += noise[0] * rng.normal(size=(count, 3))
    poses[:, 3:] = _turned(poses, noise[1] * rng.normal(size=(count, 3)))
    arrivals_s = times_s + late_s + rng.exponential(1, count) * jitter_s
    return Feed(*names, motion, times_s + clock_s, arrivals_s, poses)


def _in_plane(places: Array) -> Motion:
    """From x, y (metres) and heading at each step."""
    times = np.arange(len(places)) * STEP_S

    def motion(times_s: Array) -> Array:
        x, y, heading = (np.interp(times_s, times, column) for column in places.T)
        zero = np.zeros_like(x)
        return np.stack([x, y, zero, zero, zero, np.sin(heading / 2), np.cos(heading / 2)], axis=1)

    return motion


def _turns(before: Array, after: Array) -> Any:
    """The rotations from pose to pose, row by row."""
    return Rotation.from_quat(before[:, 3:]).inv() * Rotation.from_quat(after[:, 3:])


def _turned(poses: Array, vectors: Array) -> Array:
    """The quaternions of poses that are turned by rotation vectors."""
    turned = Rotation.from_quat(poses[:, 3:]) * Rotation.from_rotvec(vectors)
    return np.asarray(turned.as_quat())


def _array(poses: Array) -> TransformArray:
    return TransformArray(np.zeros(len(poses), np.uint8), np.zeros(len(poses), np.int64), poses)


#: A robot's links, for so many seconds.
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
