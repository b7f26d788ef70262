"""Robots with one fault each, and its id and subject as the doctor names them."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

from .ward import (
    DELAY_S,
    END_S,
    IDENTITY,
    START_S,
    Clock,
    Motion,
    Pose,
    Robot,
    circle,
    corrections,
    pose,
)

Make = Callable[[Robot], None]
Found = set[tuple[str, str]]


def moving(**wheels: Any) -> Make:
    """Only the wheels are not as they should be."""

    def make(robot: Robot) -> None:
        robot.rest()
        robot.wheels(**wheels)

    return make


def beside(send: Callable[..., None], *arguments: Any, **options: Any) -> Make:
    """A healthy robot that sends something more."""

    def make(robot: Robot) -> None:
        robot.rest()
        robot.wheels()
        send(robot, *arguments, **options)

    return make


def asked(target: str, source: str, **wheels: Any) -> Make:
    """A consumer looks up at the present and does not wait."""

    def make(robot: Robot) -> None:
        moving(**wheels)(robot)
        robot.look_up(target, source, 10.0)

    return make


def localised(
    rate_hz: float, motion: Motion, *, wheels: Motion = circle, stamp: Clock = lambda t: t
) -> Make:
    """Only the localisation is not as it should be, and perhaps how the wheels move."""

    def make(robot: Robot) -> None:
        robot.mounts()
        robot.wheels(wheels)
        robot.link("map", "odom", "amcl", rate_hz, motion, stamp=stamp)

    return make


def setup(robot: Robot, *links: tuple[str, str, Pose]) -> None:
    for parent, child, value in links:
        robot.send(parent, child, "setup", START_S, value, static=True)


def static_and_dynamic(robot: Robot, authority: str = "state publisher") -> None:
    robot.link("base", "camera", "state publisher", 10.0, lambda t: pose(0.3, 0.0, 0.5))
    robot.mount("camera", pose(0.3, 0.0, 0.5), 1.0, authority)


def flipping_parents(robot: Robot) -> None:
    robot.link("map", "cup", "table camera", 10.0, lambda t: pose(1.0))
    robot.link("base", "cup", "grasping", 10.0, lambda t: pose(0.5), stamp=lambda t: t + 0.05)


def quaternion(*turn: float) -> Make:
    return beside(Robot.link, "base", "arm", "driver", 20.0, lambda t: (0.1, 0.0, 0.0, *turn))


def clock_of_the_whole_robot_behind(robot: Robot) -> None:
    robot.mounts()
    robot.amcl(stamp=lambda t: t - 3)
    robot.wheels(stamp=lambda t: t - 3)


def jitter(robot: Robot) -> None:
    chance = random.Random(1)
    moving(stamp=lambda t: t - chance.uniform(0, 0.4))(robot)


def jittering_slowly(robot: Robot) -> None:
    chance = random.Random(1)
    localised(10.0, corrections, stamp=lambda t: t - chance.uniform(0, 0.4))(robot)


def shuffled(robot: Robot) -> None:
    chance = random.Random(1)
    moving(arrival=lambda t: t + chance.uniform(0, 0.1))(robot)


def static_that_changes(robot: Robot) -> None:
    for n in range(START_S.__trunc__(), END_S.__trunc__()):
        robot.mount("camera", pose(0.3 + 0.01 * n, 0.0, 0.5), n)


def identical_statics(robot: Robot) -> None:
    for n in range(6):
        robot.mount("camera", pose(0.3, 0.0, 0.5), n / 2, "mounts" if n % 2 else "replay")


def in_millimetres_of_a_robot_that_stands(robot: Robot) -> None:
    for child, x_m in (("camera", 0.3), ("lidar", 0.1), ("imu", 0.05), ("arm", 250.0)):
        robot.mount(child, pose(x_m))


def metres_that_become_millimetres(t: float) -> Pose:
    scale = 1 if t < 0.5 else 1000
    return (*(scale * metres for metres in circle(0.02 * t)[:3]), *IDENTITY[3:])


def jumping(by_m: Callable[[float], float]) -> Make:
    return moving(motion=lambda t: pose(circle(t)[0] + by_m(t), circle(t)[1]))


def gap(robot: Robot) -> None:
    moving(end_s=1)(robot)
    robot.link("odom", "base", "wheels", 50.0, circle, start_s=2.2)


def gap_of_all(robot: Robot) -> None:
    """The only publisher stands still, or the server."""
    robot.mounts()
    for start_s, end_s in ((START_S, 1.0), (2.0, END_S)):
        robot.link("map", "odom", "robot", 10.0, corrections, start_s=start_s, end_s=end_s)
        robot.link("odom", "base", "robot", 50.0, circle, start_s=start_s, end_s=end_s)


#: By name: the robot, and what is found.
FAULTS: dict[str, tuple[Make, Found]] = {
    "two_publishers": (
        beside(
            *(Robot.link, "odom", "base", "old driver", 50.0, lambda t: pose(9.0)),
            stamp=lambda t: t + 0.004,
        ),
        {("TF101", "base")},
    ),
    "flipping_parents": (beside(flipping_parents), {("TF102", "cup")}),
    "static_and_dynamic": (beside(static_and_dynamic), {("TF103", "camera")}),
    "static_and_dynamic_of_two": (beside(static_and_dynamic, "mounts"), {("TF101", "camera")}),
    "stopped": (moving(end_s=0.5), {("TF104", "base")}),
    "stopped_long_ago": (moving(end_s=-4), {("TF104", "base")}),
    "looked_up_after_it_stopped": (asked("odom", "base", end_s=0.5), {("TF104", "base")}),
    "gap": (gap, {("TF105", "base")}),
    "gap_of_all": (gap_of_all, {("TF105", "base")}),
    "one_stamp_two_hours_ahead": (
        moving(stamp=lambda t: t + (7200 if t == 1 else 0)),
        {("TF106", "wheels")},
    ),
    "loop": (
        beside(Robot.link, "camera", "map", "calibration", 5.0, lambda t: pose(1.0)),
        {("TF106", "calibration")},
    ),
    "quaternion_of_zeros": (quaternion(0, 0, 0, 0), {("TF106", "driver")}),
    "quaternion_that_is_long": (quaternion(0, 0, 0, 1.5), {("TF106", "driver")}),
    "quaternion_of_nan": (quaternion(0, 0, 0, math.nan), {("TF106", "driver")}),
    # A static link is sent once, so it is missing still.
    "refused_before_the_doctor_came": (
        beside(
            *(Robot.mount, "arm", (0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
            authority="driver",
        ),
        {("TF106", "driver")},
    ),
    "slow_link": (localised(1.0, corrections), {("TF107", "odom")}),
    "slow_object": (
        beside(Robot.link, "base", "tag", "detector", 1.0, corrections),
        {("TF107", "tag")},
    ),
    # Rates that nobody would mind.
    "too_late_for_lookups": (asked("map", "odom"), {("TF107", "odom")}),
    "clock_ahead": (moving(stamp=lambda t: t + 3), {("TF201", "wheels")}),
    "clock_a_little_ahead": (moving(stamp=lambda t: t + 0.5), {("TF201", "wheels")}),
    "clock_behind": (moving(stamp=lambda t: t - 3), {("TF201", "wheels")}),
    "clock_of_the_whole_robot_behind": (
        clock_of_the_whole_robot_behind,
        {("TF201", "wheels"), ("TF201", "amcl")},
    ),
    # The clock is the cause.
    "looked_up_behind_a_clock": (
        asked("odom", "base", stamp=lambda t: t - 3),
        {("TF201", "wheels")},
    ),
    "one_stamp_a_minute_ahead": (
        moving(stamp=lambda t: t + (60 if t == 1 else 0)),
        {("TF202", "base")},
    ),
    "frozen_stamp": (moving(stamp=lambda t: min(t, -5.0)), {("TF203", "base")}),
    "old_data": (
        beside(
            *(Robot.link, "odom", "base", "wheels", 10.0, circle),
            stamp=lambda t: t - 30,
            start_s=1,
            end_s=2,
        ),
        {("TF204", "base")},
    ),
    "drifting_clock": (moving(stamp=lambda t: t + 0.02 * (t - START_S)), {("TF206", "wheels")}),
    "clock_that_falls_behind": (
        moving(stamp=lambda t: t - 0.02 * (t + 200)),
        {("TF206", "wheels")},
    ),
    "simulated_time": (
        beside(
            *(Robot.link, "base", "arm", "gazebo", 30.0, circle),
            stamp=lambda t: t - 1_699_999_900,
        ),
        {("TF207", "arm")},
    ),
    "jitter": (jitter, {("TF208", "base")}),
    "jittering_slowly": (jittering_slowly, {("TF208", "odom")}),
    "out_of_order": (
        moving(arrival=lambda t: t + DELAY_S + (0.05 if round(t * 50) % 10 == 0 else 0)),
        {("TF209", "base")},
    ),
    "shuffled": (shuffled, {("TF209", "base")}),
    "once_out_of_order": (
        moving(arrival=lambda t: t + DELAY_S + (0.05 if t == 1 else 0)),
        {("TF209", "base")},
    ),
    "late_by_seconds": (
        moving(arrival=lambda t: t + DELAY_S + (2 if round(t * 50) % 10 == 0 else 0)),
        {("TF209", "base")},
    ),
    "bursts": (moving(arrival=lambda t: math.ceil(t / 0.4) * 0.4), {("TF210", "base")}),
    "second_root": (beside(setup, ("world", "table", pose(1.0))), {("TF301", "world")}),
    "names_that_differ_by_case": (beside(setup, ("Base", "imu", pose(0.1))), {("TF302", "Base")}),
    # And a root that does not.
    "a_root_that_differs_by_case": (
        beside(setup, ("site", "Map", pose(1.0)), ("world", "table", pose(1.0))),
        {("TF302", "Map"), ("TF301", "world")},
    ),
    "static_that_changes": (beside(static_that_changes), {("TF402", "camera")}),
    "static_of_two_authorities": (
        beside(Robot.mount, "camera", pose(0.32, 0.0, 0.5, 0.1), 1.0, "calibration"),
        {("TF402", "camera")},
    ),
    # By two authorities, again and again: harmless.
    "identical_statics": (beside(identical_statics), set()),
    "jump": (jumping(lambda t: 40 if t > 1 else 0), {("TF403", "base")}),
    "jump_and_back": (jumping(lambda t: 40 if t == 1 else 0), {("TF403", "base")}),
    "jump_of_a_localisation": (
        localised(10.0, lambda t: pose(0.0 if t < -2 else 40.0)),
        {("TF403", "odom")},
    ),
    "turn_about": (
        moving(
            motion=lambda t: (*circle(t)[:3], *pose(0, yaw=0.4 * t + (3 if t > 1 else 0))[3:]),
        ),
        {("TF403", "base")},
    ),
    "frozen_pose": (
        localised(10.0, lambda t: pose(0.1 * t), wheels=lambda t: circle(min(t, -1.0))),
        {("TF404", "base")},
    ),
    "mount_in_millimetres": (
        beside(Robot.mount, "imu", pose(120.0, 0.0, 35.0)),
        {("TF405", "imu")},
    ),
    "mount_in_millimetres_of_a_robot_that_stands": (
        in_millimetres_of_a_robot_that_stands,
        {("TF405", "arm")},
    ),
    "arm_in_millimetres": (
        beside(
            *(Robot.link, "base", "gripper", "arm", 50.0),
            lambda t: pose(400 + 20 * math.sin(t), 30.0, 700.0),
        ),
        {("TF405", "gripper")},
    ),
    "odometry_in_millimetres": (
        moving(motion=lambda t: (*(1000 * metres for metres in circle(t)[:3]), *circle(t)[3:])),
        {("TF405", "base")},
    ),
    "metres_that_become_millimetres": (
        moving(motion=metres_that_become_millimetres),
        {("TF405", "base")},
    ),
    "static_that_becomes_millimetres": (
        beside(Robot.mount, "camera", pose(300.0, 0.0, 500.0), 1.0),
        {("TF405", "camera")},
    ),
    "optical_frame": (
        beside(
            *(Robot.send, "camera", "camera_optical_frame", "mounts", START_S, IDENTITY),
            static=True,
        ),
        {("TF406", "camera_optical_frame")},
    ),
    "loose_mount": (
        beside(
            *(Robot.link, "base", "rear_camera", "mocap", 50.0),
            lambda t: pose(-0.3, 0.003 * math.sin(20 * t), 0.5),
        ),
        {("TF407", "rear_camera")},
    ),
}
