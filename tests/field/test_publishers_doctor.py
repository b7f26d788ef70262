"""Calibrations of the field that another publisher overrides, as the doctor sees them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.doctor.ward import END_S, START_S, Pose, Robot, observed, pose
from zenoh_tf import Transform
from zenoh_tf_tools.doctor import Finding, diagnose

OPTICAL: Pose = (0.0, 0.015, 0.0, -0.5, 0.5, -0.5, 0.5)


def tf101(robot: Robot, child: str) -> Finding:
    """The finding of two publishers, which hides what follows from it."""
    found = diagnose(observed(robot))
    assert not {each.fault.id for each in found if each.subject == child} & {"TF102", "TF103"}
    [finding] = [each for each in found if (each.fault.id, each.subject) == ("TF101", child)]
    return finding


def transform(value: Pose) -> Transform:
    return Transform(value[:3], value[3:])


# --- IFL-CAMP/easy_handeye#46


@pytest.mark.parametrize(
    ("child", "rate_hz", "stray"),
    [("camera", 10.0, pose(1.0, 1.0, 1.0)), ("gripper_cam", 50.0, pose(0.0, 0.2, 0.0, 1.5))],
)
def test_a_left_over_node_beside_a_calibration(child: str, rate_hz: float, stray: Pose) -> None:
    robot = Robot()
    robot.rest()
    robot.send("ee", child, "calibration", START_S, pose(0.03, 0.0, 0.07), static=True)
    robot.link("ee", child, "left_over", rate_hz, lambda _: stray, start_s=-5.0)
    assert tf101(robot, child).evidence == (
        "'calibration' has published the link as static, and 'left_over' publishes it as moving"
    )


@pytest.mark.parametrize("child", ["camera", "tool_cam"])
def test_the_last_word_of_a_left_over_node(child: str) -> None:
    """It has ended 4 s ago; the calibration is not what the link has."""
    robot = Robot()
    robot.rest()
    robot.send("ee", child, "calibration", START_S, pose(0.03, 0.0, 0.07), static=True)
    robot.link("ee", child, "left_over", 10.0, lambda _: pose(1.0), start_s=-5.0, end_s=-1.0)
    assert tf101(robot, child).evidence.endswith(
        "and 'left_over' publishes it as moving; 'left_over' has ended: the link is its last word "
        "until 'calibration' announces it again"
    )


def test_a_calibration_that_is_announced_again() -> None:
    """Before the doctor came, nothing of two publishers is left; while it watches, both are named,
    whoever is last."""
    for at_s, is_found in ((-1.5, False), (2.0, True)):
        robot = Robot()
        robot.rest()
        robot.send("ee", "camera", "calibration", START_S, pose(0.03), static=True)
        robot.link("ee", "camera", "left_over", 10.0, lambda _: pose(1.0), start_s=-5.0, end_s=-2.0)
        robot.send("ee", "camera", "calibration", at_s, pose(0.03), static=True)
        if is_found:
            assert tf101(robot, "camera").evidence == (
                "'left_over' has published the link as moving, and 'calibration' publishes it as "
                "static"
            )
        else:
            assert "TF101" not in {each.fault.id for each in diagnose(observed(robot))}


# --- moveit/moveit_calibration#115 and #116


def camera(robot: Robot, frames: tuple[str, str, str], optical: Pose) -> None:
    robot.rest()
    robot.wheels()
    root, middle, end = frames
    robot.send(root, middle, "driver", START_S, pose(0.0, 0.015, 0.0), static=True)
    robot.send(middle, end, "driver", START_S, optical, static=True)


@pytest.mark.parametrize("static", [False, True], ids=["moving", "static"])
@pytest.mark.parametrize(
    ("frames", "optical", "measured"),
    [
        (("camera_link", "color_frame", "color_optical"), OPTICAL, pose(0.6, 0.1, 0.9)),
        (("head", "left_frame", "left_optical"), OPTICAL, pose(-0.2, 0.3, 1.4, 2.0)),
    ],
)
def test_a_calibration_of_a_frame_that_has_a_parent(
    frames: tuple[str, str, str], optical: Pose, measured: Pose, static: bool
) -> None:
    """Both publishers, both parents, and the numbers of the link to publish instead."""
    root, middle, end = frames
    robot = Robot()
    camera(robot, frames, optical)
    if static:
        robot.send("base", end, "handeye", -1.0, measured, static=True)
    else:
        robot.link("base", end, "handeye", 5.0, lambda _: measured, start_s=-4.0)
    text = tf101(robot, end).evidence
    kind = "static" if static else "moving"
    assert text.startswith(
        f"'driver' has published the link as static below '{middle}', and 'handeye' publishes it "
        f"as {kind} below 'base'; its parent has changed once; '{root}' has lost its connection: "
        f"let 'handeye' publish 'base' -> '{root}' instead, at x "
    )
    assert text.endswith(f"(its pose times the inverse of '{root}' -> '{end}')")
    numbers = [float(word) for word in re.findall(r" [xyzw] (\S+?)(?=[ ,])", text)]
    X_root_end = transform(pose(0.0, 0.015, 0.0)) @ transform(optical)
    said = Transform(tuple(numbers[:3]), tuple(numbers[3:]))
    np.testing.assert_allclose(
        (said @ X_root_end).matrix(), transform(measured).matrix(), atol=1e-5
    )


@pytest.mark.parametrize("pan", [True, False], ids=["a joint that moves", "another tree"])
def test_no_numbers_where_they_would_not_hold(pan: bool) -> None:
    """moveit/moveit_calibration#116: the camera hangs on a joint, so its place is not constant."""
    robot = Robot()
    robot.rest()
    robot.wheels()
    if pan:
        robot.link("pan_base", "camera_link", "pan", 20.0, lambda t: pose(0.0, 0.0, 0.0, t))
    else:
        robot.send("pan_base", "camera_link", "pan", START_S, pose(1.0), static=True)
    robot.send("camera_link", "optical", "driver", START_S, OPTICAL, static=True)
    robot.link("base", "optical", "handeye", 5.0, lambda _: pose(0.6), start_s=-4.0)
    text = tf101(robot, "optical").evidence
    assert "let 'handeye' publish 'base' -> 'pan_base' instead" in text
    assert ("at x" in text) != pan


def test_the_right_calibration_is_healthy() -> None:
    """moveit/moveit_calibration#115: the link to the camera's root, which has no parent yet."""
    robot = Robot()
    camera(robot, ("camera_link", "color_frame", "color_optical"), OPTICAL)
    robot.send("base", "camera_link", "handeye", -1.0, pose(0.5, 0.1, 0.9), static=True)
    assert diagnose(observed(robot)) == []


def test_an_object_that_is_grasped_is_healthy() -> None:
    """A static object below a static table, which a gripper takes with it: no tree is split."""
    robot = Robot()
    robot.rest()
    robot.wheels()
    robot.mount("table", pose(2.0))
    robot.send("table", "cup", "vision", START_S, pose(0.1), static=True)
    robot.send("base", "cup", "gripper", END_S - 2.0, pose(0.4), static=True)
    assert "TF101" not in {each.fault.id for each in diagnose(observed(robot))}
