"""docs/tutorial/ros2.md, the demo and the compose file do what they say."""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from tests.processes import forks
from tests.processes.servers import ServerProcess
from tests.programs.test_demo import endpoint_of, processes_of
from tests.support import command_line
from zenoh_tf_server import flags

from .conftest import position

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/tutorial/ros2.md").read_text()
LINES = [
    line
    for block in re.findall(r"^```sh\n(.*?)^```", PAGE, re.M | re.S)
    for line in block.splitlines()
]


def start(*command: str) -> subprocess.Popen[str]:
    return forks.Popen([sys.executable, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE)


(_SERVER,) = (line for line in LINES if "--listen" in line)
FLAGS = tuple(shlex.split(_SERVER.partition("--listen")[0])[1:])


def test_the_first_five_minutes(server: ServerProcess) -> None:
    robot_line, *questions = [line for line in LINES if line.startswith(("python ", "zenoh-tf "))]
    _, script = shlex.split(robot_line)
    with start(str(ROOT / script), "--connect", server.endpoint) as robot:
        try:
            with server.connect() as tf:
                position(tf, "odom", "laser")
            found = {}
            for line in questions:
                arguments = [*shlex.split(line)[1:], "--connect", server.endpoint]
                done = command_line.run(*arguments)
                assert done.returncode == 0, done.stderr
                found[line] = done.stdout
        finally:
            robot.send_signal(signal.SIGINT)
            _, errors = robot.communicate(timeout=20)
    assert robot.returncode == 0 and errors == ""
    assert "ros2:0/robot" in found["zenoh-tf authorities"]
    assert "base_link" in found["zenoh-tf frames"]
    (shown,) = re.findall(r"^```text\n(.*?)^```", PAGE, re.M | re.S)
    assert command_line.shape(found["zenoh-tf lookup odom laser"]) == command_line.shape(shown)


def test_the_demo() -> None:
    with start(str(ROOT / "examples/demo_ros2.py")) as demo:
        page, errors = demo.communicate(timeout=150)
    assert demo.returncode == 0, errors
    assert errors == ""
    for name in ("robot1/laser", "robot2/camera", "ros2:0/robot1/robot", "hears on /tf: goal"):
        assert name in " ".join(page.split())
    assert processes_of(endpoint_of(page)) == []


def test_the_containers_of_the_compose_file(server: ServerProcess) -> None:
    """Its server's flags are right, and its robots run."""
    services: dict[str, Any] = YAML(typ="safe").load(ROOT / "docker/compose-ros2.yaml")["services"]
    options = flags.parse(services.pop("server")["command"])
    assert options.ros2 and options.ros2_shared == ("map",)
    for name, service in services.items():
        command = [*service["entrypoint"], *service["command"]]
        assert command[:2] == ["python", "ros2_robot.py"]
        command[3] = server.endpoint
        robot = start(str(ROOT / "examples/ros2_robot.py"), *command[2:], "--seconds", "1")
        _, errors = robot.communicate(timeout=150)
        assert robot.returncode == 0, errors
        with server.connect() as tf:
            assert f"ros2:0/{name}/robot" in [each.name for each in tf.authorities()]


def test_flags_in_a_file(tmp_path: Path) -> None:
    config = tmp_path / "server.toml"
    config.write_text(
        'ros2 = true\nros2-prefix = ["namespace"]\nros2-shared = "map,world"\n'
        'ros2-publish = ["goal*"]\nros2-domain = 4\n'
    )
    settings = flags.settings(flags.parse(["--config", str(config)])).ros2
    assert settings.receive and settings.enabled and settings.domain == 4
    assert settings.shared == ("map", "world") and settings.publish == ("goal*",)
    assert [rule.kind for rule in settings.rules] == ["namespace"]
