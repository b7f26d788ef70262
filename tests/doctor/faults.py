"""Robots with one fault each: its id and subject as the doctor names them."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from .ward import (
    DELAY_S,
    END_S,
    IDENTITY,
    START_S,
    Pose,
    Robot,
    circle,
    corrections,
    pose,
)

Found = set[tuple[str, str]]


def two_publishers(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("odom", "base", "old driver", 50.0, lambda t: pose(9.0), stamp=lambda t: t + 0.004)
    return {("TF101", "base")}


def stopped(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(end_s=0.5)
    return {("TF104", "base")}


def stopped_long_ago(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(end_s=-4)
    return {("TF104", "base")}


def clock_ahead(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: t + 3)
    return {("TF201", "wheels")}


def clock_a_little_ahead(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: t + 0.5)
    return {("TF201", "wheels")}


def one_stamp_two_hours_ahead(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: t + (7200 if t == 1 else 0))
    return {("TF106", "wheels")}


def loop(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("camera", "map", "calibration", 5.0, lambda t: pose(1.0))
    return {("TF106", "calibration")}


def second_root(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.send("world", "table", "setup", START_S, pose(1.0), static=True)
    return {("TF301", "world")}


def names_that_differ_by_case(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.send("Base", "imu", "setup", START_S, pose(0.1), static=True)
    return {("TF302", "Base")}


def a_root_that_differs_by_case(robot: Robot) -> Found:
    """And one that does not."""
    robot.rest()
    robot.wheels()
    robot.send("site", "Map", "setup", START_S, pose(1.0), static=True)
    robot.send("world", "table", "setup", START_S, pose(1.0), static=True)
    return {("TF302", "Map"), ("TF301", "world")}


def old_data(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("odom", "base", "wheels", 10.0, circle, stamp=lambda t: t - 30, start_s=1, end_s=2)
    return {("TF204", "base")}


def static_and_dynamic(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("base", "camera", "state publisher", 10.0, lambda t: pose(0.3, 0.0, 0.5))
    robot.mount("camera", pose(0.3, 0.0, 0.5), 1.0)
    return {("TF103", "camera")}


def flipping_parents(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("map", "cup", "table camera", 10.0, lambda t: pose(1.0))
    robot.link("base", "cup", "grasping", 10.0, lambda t: pose(0.5), stamp=lambda t: t + 0.05)
    return {("TF102", "cup")}


def quaternion(*turn: float) -> Callable[[Robot], Found]:
    def make(robot: Robot) -> Found:
        robot.rest()
        robot.wheels()
        robot.link("base", "arm", "driver", 20.0, lambda t: (0.1, 0.0, 0.0, *turn))
        return {("TF106", "driver")}

    return make


def refused_before_the_doctor_came(robot: Robot) -> Found:
    """A static link is sent once, so it is missing still."""
    robot.rest()
    robot.wheels()
    robot.mount("arm", (0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), authority="driver")
    return {("TF106", "driver")}


def clock_behind(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: t - 3)
    return {("TF201", "wheels")}


def clock_of_the_whole_robot_behind(robot: Robot) -> Found:
    robot.mounts()
    robot.amcl(stamp=lambda t: t - 3)
    robot.wheels(stamp=lambda t: t - 3)
    return {("TF201", "wheels"), ("TF201", "amcl")}


def frozen_stamp(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: min(t, -5.0))
    return {("TF203", "base")}


def simulated_time(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("base", "arm", "gazebo", 30.0, circle, stamp=lambda t: t - 1_699_999_900)
    return {("TF207", "arm")}


def one_stamp_a_minute_ahead(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: t + (60 if t == 1 else 0))
    return {("TF202", "base")}


def drifting_clock(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: t + 0.02 * (t - START_S))
    return {("TF206", "wheels")}


def clock_that_falls_behind(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(stamp=lambda t: t - 0.02 * (t + 200))
    return {("TF206", "wheels")}


def jitter(robot: Robot) -> Found:
    robot.rest()
    chance = random.Random(1)
    robot.wheels(stamp=lambda t: t - chance.uniform(0, 0.4))
    return {("TF208", "base")}


def jittering_slowly(robot: Robot) -> Found:
    robot.mounts()
    robot.wheels()
    chance = random.Random(1)
    robot.amcl(stamp=lambda t: t - chance.uniform(0, 0.4))
    return {("TF208", "odom")}


def static_that_changes(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    for n in range(START_S.__trunc__(), END_S.__trunc__()):
        robot.mount("camera", pose(0.3 + 0.01 * n, 0.0, 0.5), n)
    return {("TF402", "camera")}


def static_of_two_authorities(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.mount("camera", pose(0.32, 0.0, 0.5, 0.1), 1.0, "calibration")
    return {("TF402", "camera")}


def slow_link(robot: Robot) -> Found:
    robot.mounts()
    robot.wheels()
    robot.amcl(1.0)
    return {("TF107", "odom")}


def slow_object(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("base", "tag", "detector", 1.0, corrections)
    return {("TF107", "tag")}


def too_late_for_lookups(robot: Robot) -> Found:
    """Rates that nobody would mind, but a consumer looks up at the present and does not wait."""
    robot.rest()
    robot.wheels()
    robot.look_up("map", "odom", 10.0)
    return {("TF107", "odom")}


def looked_up_behind_a_clock(robot: Robot) -> Found:
    """The clock is the cause."""
    robot.rest()
    robot.wheels(stamp=lambda t: t - 3)
    robot.look_up("odom", "base", 10.0)
    return {("TF201", "wheels")}


def looked_up_after_it_stopped(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(end_s=0.5)
    robot.look_up("odom", "base", 10.0)
    return {("TF104", "base")}


def optical_frame(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.send("camera", "camera_optical_frame", "mounts", START_S, IDENTITY, static=True)
    return {("TF406", "camera_optical_frame")}


def frozen_pose(robot: Robot) -> Found:
    robot.mounts()
    robot.link("map", "odom", "amcl", 10.0, lambda t: pose(0.1 * t))
    robot.wheels(lambda t: circle(min(t, -1.0)))
    return {("TF404", "base")}


def out_of_order(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(arrival=lambda t: t + DELAY_S + (0.05 if round(t * 50) % 10 == 0 else 0))
    return {("TF209", "base")}


def shuffled(robot: Robot) -> Found:
    robot.rest()
    chance = random.Random(1)
    robot.wheels(arrival=lambda t: t + chance.uniform(0, 0.1))
    return {("TF209", "base")}


def once_out_of_order(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(arrival=lambda t: t + DELAY_S + (0.05 if t == 1 else 0))
    return {("TF209", "base")}


def jump(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(lambda t: pose(circle(t)[0] + (40 if t > 1 else 0), circle(t)[1]))
    return {("TF403", "base")}


def jump_and_back(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(lambda t: pose(circle(t)[0] + (40 if t == 1 else 0), circle(t)[1]))
    return {("TF403", "base")}


def jump_of_a_localisation(robot: Robot) -> Found:
    robot.mounts()
    robot.wheels()
    robot.link("map", "odom", "amcl", 10.0, lambda t: pose(0.0 if t < -2 else 40.0))
    return {("TF403", "odom")}


def turn_about(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(lambda t: (*circle(t)[:3], *pose(0, yaw=0.4 * t + (3 if t > 1 else 0))[3:]))
    return {("TF403", "base")}


def mount_in_millimetres(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.mount("imu", pose(120.0, 0.0, 35.0))
    return {("TF405", "imu")}


def mount_in_millimetres_of_a_robot_that_stands(robot: Robot) -> Found:
    for child, x_m in (("camera", 0.3), ("lidar", 0.1), ("imu", 0.05), ("arm", 250.0)):
        robot.mount(child, pose(x_m))
    return {("TF405", "arm")}


def late_by_seconds(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(arrival=lambda t: t + DELAY_S + (2 if round(t * 50) % 10 == 0 else 0))
    return {("TF209", "base")}


def arm_in_millimetres(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link("base", "gripper", "arm", 50.0, lambda t: pose(400 + 20 * math.sin(t), 30.0, 700.0))
    return {("TF405", "gripper")}


def odometry_in_millimetres(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(lambda t: (*(1000 * metres for metres in circle(t)[:3]), *circle(t)[3:]))
    return {("TF405", "base")}


def metres_that_become_millimetres(robot: Robot) -> Found:
    robot.rest()

    def motion(t: float) -> Pose:
        scale = 1 if t < 0.5 else 1000
        return (*(scale * metres for metres in circle(0.02 * t)[:3]), *IDENTITY[3:])

    robot.wheels(motion)
    return {("TF405", "base")}


def static_that_becomes_millimetres(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.mount("camera", pose(300.0, 0.0, 500.0), 1.0)
    return {("TF405", "camera")}


def identical_statics(robot: Robot) -> Found:
    """By two authorities, again and again: harmless."""
    robot.rest()
    robot.wheels()
    for n in range(6):
        robot.mount("camera", pose(0.3, 0.0, 0.5), n / 2, "mounts" if n % 2 else "replay")
    return set()


def loose_mount(robot: Robot) -> Found:
    robot.rest()
    robot.wheels()
    robot.link(
        "base", "rear_camera", "mocap", 50.0, lambda t: pose(-0.3, 0.003 * math.sin(20 * t), 0.5)
    )
    return {("TF407", "rear_camera")}


def bursts(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(arrival=lambda t: math.ceil(t / 0.4) * 0.4)
    return {("TF210", "base")}


def gap(robot: Robot) -> Found:
    robot.rest()
    robot.wheels(end_s=1)
    robot.link("odom", "base", "wheels", 50.0, circle, start_s=2.2)
    return {("TF105", "base")}


FAULTS = [
    two_publishers, stopped, stopped_long_ago, clock_ahead, clock_a_little_ahead,
    one_stamp_two_hours_ahead, loop, second_root, names_that_differ_by_case,
    a_root_that_differs_by_case, old_data,
    static_and_dynamic, flipping_parents,
    quaternion(0, 0, 0, 0), quaternion(0, 0, 0, 1.5), quaternion(0, 0, 0, math.nan),
    refused_before_the_doctor_came, clock_behind, clock_of_the_whole_robot_behind, frozen_stamp,
    simulated_time, one_stamp_a_minute_ahead, drifting_clock, clock_that_falls_behind, jitter,
    jittering_slowly, static_that_changes, static_of_two_authorities, slow_link, slow_object,
    too_late_for_lookups, looked_up_behind_a_clock, looked_up_after_it_stopped,
    optical_frame, frozen_pose, out_of_order, shuffled, once_out_of_order, jump, jump_and_back,
    jump_of_a_localisation, turn_about, mount_in_millimetres,
    mount_in_millimetres_of_a_robot_that_stands, late_by_seconds, arm_in_millimetres,
    odometry_in_millimetres, metres_that_become_millimetres, static_that_becomes_millimetres,
    identical_statics, loose_mount, bursts, gap,
]  # fmt: skip
