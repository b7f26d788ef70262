"""Public reports about commands: what people type, what programs read, what files keep."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.support import command_line
from tests.support.command_line import Done
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

S = 10**9
Command = Callable[..., Done]


@pytest.fixture
def command(shared_server: ServerProcess, capsys: pytest.CaptureFixture[str]) -> Command:
    return partial(command_line.call, capsys, "--connect", shared_server.endpoint)


@pytest.fixture
def tf(shared_server: ServerProcess) -> Iterator[TransformClient]:
    with shared_server.connect() as tf:
        yield tf
        tf.clear(keep_static=False)


@pytest.mark.parametrize(
    ("typed", "xyz", "yaw"),
    [
        ("0 0 0 0 0 0 map origin", (0, 0, 0), 0.0),
        ("-1e-05 1E-3 -.5 -3e-2 0 0 map origin", (-1e-5, 1e-3, -0.5), -0.03),
        ("--y -1.5e-3 --yaw -9e-1 --frame-id map --child-frame-id origin", (0, -0.0015, 0), -0.9),
        ("--frame-id=map --child-frame-id=origin --z=-2", (0, 0, -2), 0.0),
    ],
)
def test_the_forms_that_people_use(
    tf: TransformClient, command: Command, typed: str, xyz: tuple[float, ...], yaw: float
) -> None:
    """ros-navigation/navigation2_tutorials#134, ros2/geometry2#295: releases take either form, and
    files that are generated have numbers such as -1e-05."""
    done = command("static", *typed.split())
    assert (done.returncode, done.stderr) == (0, "")
    found = tf.lookup_transform("map", "origin").transform
    np.testing.assert_allclose(found.translation, xyz)
    np.testing.assert_allclose(found.rotation[2:], (math.sin(yaw / 2), math.cos(yaw / 2)))


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("--x 0 --roll 0 -- yaw 0 --frame-id base_link --child-frame-id imu", "'yaw', '0'"),
        ("--frame-id base --child-frame-id imu -- z 1.5", "'z', '1.5'"),
        ("0 0 0 0 0 0 base cam 100", "leave out the period '100'"),
        ("0 0 0 0 0 0 1 base cam 30.5", "leave out the period '30.5'"),
        ("0 0 0 0 0 0 base cam --ros-args -r __node:=x", "--ros-args -r __node:=x"),
        ("0,5 0 0 0 0 0 base cam", "'0,5' is not a number"),
    ],
)
def test_arguments_of_other_programs(command: Command, typed: str, said: str) -> None:
    """septentrio-gnss/septentrio_gnss_driver#181, moveit/moveit#1494, ros2/geometry2#80: a space
    after two dashes, the period of tf's publisher, and what a launch file adds. The error says
    which argument it is."""
    done = command("static", *typed.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr.splitlines()[0]


def strict(text: str) -> Any:
    """JSON as browsers read it: without NaN and Infinity."""

    def refuse(constant: str) -> NoReturn:
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize(
    "typed",
    [
        "frames",
        "frame once",
        "lookup map once",
        "latest map once",
        "estimate map once",
        "stats",
        "authorities",
        "clients",
        "doctor --for 0s",
        "explain map once",
    ],
)
def test_json_is_json(tf: TransformClient, command: Command, typed: str, samples: int) -> None:
    """RobotWebTools/rosbridge_suite#916, RobotWebTools/roslibjs#68: a number that is not there made
    a text that no browser reads. A link with one sample has no rate and no speed."""
    for number in range(samples):
        tf.set_transform(StampedTransform("map", "once", 5 * S + number, Transform()))
    done = command("--json", *typed.split())
    strict(done.stdout or done.stderr)


@pytest.mark.parametrize(
    "origin", [(388_096.123456789, 3_948_996.987654321, 40.5), (-2e-9, 5_572_094.155411, 1e-7)]
)
def test_coordinates_keep_their_digits(
    tf: TransformClient, command: Command, tmp_path: Path, origin: tuple[float, float, float]
) -> None:
    """koide3/hdl_graph_slam#182: a saved origin in UTM had six digits left, and the map was metres
    away after it was loaded."""
    turn = (0.1, -0.2, 0.3, math.sqrt(0.86))
    placed = StampedTransform("utm", "map", 0, Transform(origin, turn))
    tf.set_transform(placed, static=True)
    found = strict(command("--json", "lookup", "utm", "map").stdout)
    assert tuple(found["translation"]) == origin
    file = str(tmp_path / "site.toml")
    assert command("calibration", "save", file).returncode == 0
    tf.clear(keep_static=False)
    assert command("calibration", "load", file).returncode == 0
    again = tf.lookup_transform("utm", "map").transform
    assert again.translation.tolist() == list(origin)
    np.testing.assert_allclose(again.rotation, placed.transform.rotation, rtol=0, atol=1e-15)


@pytest.mark.parametrize("quoted", ["'Fixed Jaw'", "'robot::jaw 1'", "-- -jaw"])
def test_names_that_a_shell_must_quote(tf: TransformClient, command: Command, quoted: str) -> None:
    """TheRobotStudio/SO-ARM100#87: links with spaces had to be renamed before other programs took
    the robot."""
    *_, name = shlex.split(quoted)
    done = command("static", *shlex.split(f"0 0 1 0 0 0 map {quoted}"))
    assert (done.returncode, done.stdout) == (0, f"map -> {name} stored, static\n")
    assert strict(command("--json", "lookup", *shlex.split(f"map {quoted}")).stdout)
    assert f'"{name}"' in command("frames", "--dot").stdout
    assert name in tf.frames()
