"""A robot in simulated time, its tree, and what a doctor sees of it in three seconds.

The tree and the observation get what a server and its stream would give, but at times that do not
depend on the machine.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from zenoh_tf import AuthorityInfo, FrameInfo, TransformTree
from zenoh_tf._core import OP_AT, TransformRows
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf_server.limits import Limits
from zenoh_tf_tools.doctor import LinkFacts, Observation, TreeFacts

S: Final = 10**9
#: The clock when the doctor comes.
NOW_NS: Final = 1_700_000_000 * S
#: Robots run from this time on, in seconds, and the doctor leaves at the end.
START_S: Final = -9.0
END_S: Final = 3.0
DELAY_S: Final = 0.01

Pose = tuple[float, ...]
Motion = Callable[[float], Pose]
Clock = Callable[[float], float]
#: Arrival in s, authority, whether static, parent, child, stamp in s, pose.
Sent = tuple[float, str, bool, str, str, float, Pose]
#: When in s, target, source, and the stamp asked for, in s.
Asked = tuple[float, str, str, float]

IDENTITY: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def pose(x: float, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Pose:
    return (x, y, z, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def circle(t: float) -> Pose:
    """2 m of radius at 0.8 m/s."""
    return pose(2 * math.cos(0.4 * t), 2 * math.sin(0.4 * t), 0.0, 0.4 * t)


def corrections(t: float) -> Pose:
    """A localisation: still, but for a centimetre now and then."""
    return pose(0.01 * math.floor(t), 0.0, 0.0, 0.001 * math.floor(t))


class Robot:
    """What its publishers send, and what its consumers ask for."""

    def __init__(self) -> None:
        self.sent: list[Sent] = []
        self.asked: list[Asked] = []

    def link(
        self,
        parent: str,
        child: str,
        authority: str,
        rate_hz: float,
        motion: Motion,
        *,
        stamp: Clock = lambda t: t,
        arrival: Clock = lambda t: t + DELAY_S,
        start_s: float = START_S,
        end_s: float = END_S,
    ) -> None:
        """A dynamic link: `stamp` and `arrival` of a sample that was measured at a time."""
        for n in range(round((end_s - start_s) * rate_hz)):
            t = start_s + n / rate_hz
            self.send(parent, child, authority, stamp(t), motion(t), arrival=arrival(t))

    def send(
        self,
        parent: str,
        child: str,
        authority: str,
        stamp_s: float,
        pose: Pose,
        *,
        arrival: float | None = None,
        static: bool = False,
    ) -> None:
        at_s = stamp_s + DELAY_S if arrival is None else arrival
        self.sent.append((at_s, authority, static, parent, child, stamp_s, pose))

    def amcl(self, rate_hz: float = 10.0, *, stamp: Clock = lambda t: t) -> None:
        self.link("map", "odom", "amcl", rate_hz, corrections, stamp=stamp)

    def wheels(
        self,
        motion: Motion = circle,
        *,
        stamp: Clock = lambda t: t,
        arrival: Clock = lambda t: t + DELAY_S,
        end_s: float = END_S,
    ) -> None:
        self.link("odom", "base", "wheels", 50.0, motion, stamp=stamp, arrival=arrival, end_s=end_s)

    def mount(
        self, child: str, value: Pose, at_s: float = START_S, authority: str = "mounts"
    ) -> None:
        self.send("base", child, authority, at_s, value, static=True)

    def look_up(self, target: str, source: str, rate_hz: float, stamp: Clock = lambda t: t) -> None:
        """Lookups by query that do not wait: at the present, or at the stamps."""
        for n in range(round(END_S * rate_hz)):
            t = n / rate_hz + 0.001  # after what is sent at that time
            self.asked.append((t, target, source, stamp(t)))

    def rest(self) -> None:
        """All but the wheels."""
        self.amcl()
        self.mounts()

    def mounts(self) -> None:
        self.mount("camera", pose(0.3, 0.0, 0.5))
        self.mount("lidar", pose(0.1, 0.0, 0.8))


class Service:
    """What a server has of the robot, and counts about its publishers."""

    def __init__(self) -> None:
        self.tree = TransformTree(time_jump="clear")
        self.stored: dict[str, dict[int, tuple[str, Pose]]] = defaultdict(dict)
        self._refused: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._leads: dict[str, list[float]] = defaultdict(list)

    def put(self, sent: Sent) -> bool:
        """Commit a sample. False: it is refused, or dropped, so the stream does not have it."""
        at_s, authority, static, parent, child, stamp_s, value = sent
        rows = TransformRows.of_tuples([(parent, child, at_ns(stamp_s), value)])
        dropped = self.tree.frame(child).dropped if child in self.tree.frames() else 0
        try:
            if stamp_s - at_s > 3600:
                raise InvalidArgumentException(f"'{child}': the stamp is too far ahead")
            self.tree._commit_rows(rows, authority=authority, static=static, drop_old=True)
        except InvalidArgumentException as error:
            self._refused[authority] += 1
            self._reasons[authority] = str(error)
            return False
        if not static and at_s > END_S - 15:
            self._leads[authority].append(stamp_s - at_s)
        if self.tree.frame(child).dropped > dropped:
            return False
        samples = self.stored[child]
        if static or (samples and parent != next(iter(samples.values()))[0]):
            samples.clear()
        samples[0 if static else at_ns(stamp_s)] = (parent, value)
        return True

    def ask(self, asked: Asked) -> None:
        """Look up as a server does for its clients."""
        _, target, source, stamp_s = asked
        names = np.array([0], np.uint32), np.array([1], np.uint32)
        self.tree._read_rows(
            (target, source), np.array([OP_AT], np.uint8), *names, np.array([at_ns(stamp_s)]),
            budget=Limits().budget(),
        )  # fmt: skip

    def frames(self) -> dict[str, FrameInfo]:
        return {name: self.tree.frame(name) for name in self.tree.frames()}

    def authorities(self) -> list[AuthorityInfo]:
        known = {each.name: each for each in self.tree.authorities()}
        for name in self._refused:
            known.setdefault(name, AuthorityInfo(name, 0, 0, 0, 0, 0, 0))
        return [
            replace(
                each,
                clock_offset_min_s=min(self._leads[name], default=None),
                clock_offset_max_s=max(self._leads[name], default=None),
                refused=self._refused[name],
                last_refusal=self._reasons.get(name),
            )
            for name, each in known.items()
        ]


def at_ns(at_s: float) -> int:
    return NOW_NS + round(at_s * S)


def observed(robot: Robot) -> TreeFacts:
    """What a doctor sees who watches the robot from 0 s on."""
    service, observation = Service(), Observation()
    before: dict[str, FrameInfo] | None = None
    authorities_before: list[AuthorityInfo] = []
    events: list[Sent | Asked] = [*robot.sent, *robot.asked]
    for sent in sorted(events, key=lambda event: event[0]):
        if sent[0] >= 0 and before is None:
            before, authorities_before = service.frames(), service.authorities()
            _load(observation, service)
        if len(sent) == 4:
            service.ask(sent)
        elif service.put(sent) and before is not None:
            arrival_s, authority, static, parent, child, stamp_s, value = sent
            observation.add(
                *(at_ns(arrival_s), child, parent, at_ns(stamp_s), np.array(value), authority),
                static=static,
            )
    if before is None:  # nothing comes any more
        before, authorities_before = service.frames(), service.authorities()
        _load(observation, service)
    seen = observation.seen()
    links = [
        LinkFacts(frame, before.get(name), seen.get(name))
        for name, frame in service.frames().items()
    ]
    return TreeFacts(links, at_ns(END_S), END_S, service.authorities(), authorities_before)


def _load(observation: Observation, service: Service) -> None:
    for child, samples in service.stored.items():
        frame = service.tree.frame(child)
        if frame.static:
            ((parent, value),) = samples.values()
            observation.add(None, child, parent, 0, np.array(value), frame.authority, static=True)
        else:
            history = sorted(samples.items())
            observation.load(
                child,
                history[-1][1][0],
                np.array([stamp for stamp, _ in history]),
                np.array([value for _, (_, value) in history]),
            )
