"""Healthy robots, in which the doctor finds nothing."""

from __future__ import annotations

import functools
import math
import random

from .ward import DELAY_S, END_S, START_S, Clock, Robot, circle, corrections, pose


def steady(robot: Robot) -> None:
    robot.rest()
    robot.wheels()


def parked(robot: Robot) -> None:
    """All poses are the same, to the last bit."""
    robot.mounts()
    robot.link("map", "odom", "amcl", 10.0, lambda t: pose(3.0, 1.0))
    robot.wheels(lambda t: pose(3.0, 1.0, 0.0, 0.4))


def stop_and_go(robot: Robot) -> None:
    """It halts within 0.3 s, stands, and continues; its arm moves meanwhile."""
    robot.rest()
    robot.wheels(lambda t: circle(min(t, -4.0) if t < -4 else -4 + max(0.0, t) ** 2 / 20))
    robot.link("base", "arm", "arm", 50.0, lambda t: pose(0.1, yaw=math.sin(t)))
    robot.link("base", "wheel", "joints", 50.0, lambda t: pose(0.0, 0.2, yaw=20 * t))


def loaded_network(robot: Robot) -> None:
    """Delays of up to 40 ms, in order."""
    robot.rest()
    chance = random.Random(1)
    last = 0.0

    def arrival(t: float) -> float:
        nonlocal last
        last = max(last, t + chance.uniform(0.001, 0.04))
        return last

    robot.wheels(arrival=arrival)


def standstill(robot: Robot) -> None:
    """The simulator stands still for all links, and its clock with it."""
    _all_links(robot, lambda t: t + DELAY_S + (t > 1), lambda t: t - 1_699_999_900)


def network_that_stands_still(robot: Robot) -> None:
    """For all links, whose samples come late."""
    _all_links(robot, lambda t: DELAY_S + (2 + t / 1e3 if 1 < t < 2 else t))


def _all_links(robot: Robot, arrival: Clock, stamp: Clock = lambda t: t) -> None:
    robot.mounts()
    link = functools.partial(robot.link, stamp=stamp, arrival=arrival, end_s=END_S - 1)
    link("map", "odom", "amcl", 10.0, corrections)
    link("odom", "base", "wheels", 50.0, circle)


def simulation(robot: Robot) -> None:
    """All stamps are of simulated time, which runs at 0.9 of real time."""
    robot.mounts()
    robot.amcl(stamp=lambda t: 0.9 * t - 1_699_999_900)
    robot.wheels(stamp=lambda t: 0.9 * t - 1_699_999_900)


def static_only(robot: Robot) -> None:
    robot.mounts()
    robot.send("camera", "camera_optical", "mounts", START_S, (0, 0, 0, -0.5, 0.5, -0.5, 0.5))
    robot.sent = [(*sent[:2], True, *sent[3:]) for sent in robot.sent]


def grasping(robot: Robot) -> None:
    """A cup is seen, grasped and set down."""
    robot.rest()
    robot.wheels()
    robot.link("map", "cup", "camera", 15.0, lambda t: pose(2.0, 3.0), end_s=0.5)
    robot.link("base", "cup", "planner", 15.0, lambda t: pose(0.4), start_s=0.6, end_s=1.5)
    robot.link("map", "cup", "planner", 15.0, lambda t: pose(2.5, 3.0), start_s=1.6)


def farm(robot: Robot) -> None:
    """Docks are far from the map's origin, and the map from that of UTM."""
    steady(robot)
    robot.send("utm", "map", "setup", START_S, pose(500_000.0, 5_000_000.0), static=True)
    robot.send("map", "dock", "setup", START_S, pose(900.0), static=True)
    robot.send("odom", "start", "setup", START_S, pose(45.0), static=True)


def planner(robot: Robot) -> None:
    """A gripper is set to and fro by 0.2 m, as fast as its planner can."""
    steady(robot)
    robot.link("base", "gripper", "planner", 500.0, lambda t: pose(0.2 * (round(500 * t) % 2)))


def asked_nonsense(robot: Robot) -> None:
    """Its clients ask for the past, which works, and for times that no link can have."""
    steady(robot)
    robot.look_up("map", "base", 10.0, lambda t: t - 0.2)
    robot.look_up("map", "base", 10.0, lambda t: t + 3600)  # another time zone
    robot.look_up("map", "base", 10.0, lambda t: t + 12)
    robot.look_up("map", "base", 10.0, lambda t: t * 1e-9 - 1_699_999_998.3)  # s given as ns
    robot.look_up("map", "nowhere", 10.0)


def post_dated(robot: Robot) -> None:
    """AMCL stamps its corrections 1 s ahead, so that lookups at the present work."""
    robot.mounts()
    robot.wheels()
    robot.amcl(stamp=lambda t: t + 1)


HEALTHY = [
    steady, parked, stop_and_go, loaded_network, standstill, network_that_stands_still, simulation,
    static_only, grasping, farm, planner, post_dated, asked_nonsense,
]  # fmt: skip
