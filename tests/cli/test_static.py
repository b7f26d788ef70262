"""``zenoh-tf static``: tf2's forms of arguments, and angles of ``set``."""

from __future__ import annotations

import math

import pytest

from tests.support.command_line import Run
from zenoh_tf import Transform
from zenoh_tf_client import TransformClient

HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            "1 -2 3e-1 1.5707963267948966 0 0 base_link lens",
            Transform((1, -2, 0.3), (0, 0, HALF, HALF)),
        ),
        ("0 0 0 0.3 -0.2 0.1 base_link lens", Transform.from_rpy(0.1, -0.2, 0.3)),
        ("0 0 0 -90deg 0 0.1rad base_link lens", Transform.from_rpy(0.1, 0.0, -math.pi / 2)),
        (
            "--yaw -90deg --roll 1e-1 --frame-id base_link --child-frame-id lens",
            Transform.from_rpy(0.1, 0.0, -math.pi / 2),
        ),
        ("1 2 3 0 0 -0.6 0.8 base_link lens", Transform((1, 2, 3), (0, 0, -0.6, 0.8))),
        ("--x 1 --z -3 --frame-id base_link --child-frame-id lens", Transform((1, 0, -3))),
        (
            "--roll 0.1 --pitch -0.2 --yaw 0.3 --frame-id base_link --child-frame-id lens",
            Transform.from_rpy(0.1, -0.2, 0.3),
        ),
        (
            "--y -2 --qz -0.6 --qw 0.8 --frame-id base_link --child-frame-id lens",
            Transform((0, -2, 0), (0, 0, -0.6, 0.8)),
        ),
    ],
)
def test_the_forms_of_tf2(
    robot: TransformClient, command: Run, arguments: str, expected: Transform
) -> None:
    ended = command("static", *arguments.split())
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout == "base_link -> lens stored, static\n"
    found = robot.lookup_transform("base_link", "lens").transform
    assert found.matrix().flatten().tolist() == pytest.approx(
        expected.matrix().flatten().tolist(), abs=1e-12
    )
    assert robot.frame("lens").static


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("", "give --frame-id and --child-frame-id"),
        ("1 2 3 base_link lens", "6 or 7 numbers and two frames, not 5 arguments"),
        ("1 2 3 4 5 base_link lens", "not 7 arguments"),
        ("1 2 3 4 5 6 7 8 base_link lens", "not 10 arguments"),
        ("1 2 3 4 5 six base_link lens", "'six' is not an angle; give 90deg"),
        ("1 2 3 0 0 0 base_link lens --x 1", "--x cannot be combined with arguments in a row"),
        ("--x 1 --frame-id base_link", "give --frame-id and --child-frame-id"),
        ("--yaw 1 --qw 1 --frame-id a --child-frame-id b", "angles or a quaternion, not both"),
        ("--x one --frame-id a --child-frame-id b", "'one' is not a number"),
        ("--x 90deg --frame-id a --child-frame-id b", "'90deg' is not a number"),
        ("0 0 0 0 0 0 90deg a b", "'90deg' is not a number"),
        ("0 0 0 90grad 0 0 a b", "'90grad' is not an angle; give 90deg or 1.57rad"),
    ],
)
def test_other_forms_are_refused(command: Run, arguments: str, said: str) -> None:
    ended = command("static", *arguments.split())
    assert (ended.returncode, ended.stdout) == (2, "")
    assert said in ended.stderr


def test_what_the_server_refuses(robot: TransformClient, command: Run) -> None:
    ended = command("static", *["0", "0", "0", "0", "0", "0", "5", "base_link", "lens"])
    assert ended.returncode == 1
    assert "quaternion" in ended.stderr
    assert "cycle" in command("static", *["0", "0", "0", "0", "0", "0", "base_link", "map"]).stderr


def test_set_takes_angles(robot: TransformClient, command: Run) -> None:
    arguments = ("map", "cup", "1", "2", "3", "--yaw", "-90deg", "--roll", "0.1rad")
    assert command("set", *arguments).returncode == 0
    found = robot.lookup_transform("map", "cup").transform
    expected = Transform.from_rpy(0.1, 0.0, -math.pi / 2, translation=(1, 2, 3))
    assert found.pose() == pytest.approx(expected.pose())
