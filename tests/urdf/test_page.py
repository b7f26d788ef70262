"""docs/urdf.md and the help of the command say what is so: every line runs."""

from __future__ import annotations

import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from zenoh_tf_client.urdf import joint_states, kinematics

from ..conftest import ServerProcess, free_endpoint

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/urdf.md").read_text()
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.M | re.S)
LINES = [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()]


@pytest.fixture(scope="module")
def shared_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    server = ServerProcess(tmp_path_factory.mktemp("server") / "log", free_endpoint(), "main", ())
    yield server
    server.stop()


def run(line: str, endpoint: str, folder: Path) -> str:
    """What a line prints; one that follows a robot is interrupted."""
    command, *arguments = shlex.split(line)
    assert command == "zenoh-tf"
    shutil.copy(Path(__file__).with_name("arm.urdf"), folder / "robot.urdf")
    process = subprocess.Popen(
        [sys.executable, "-m", "zenoh_tf_client", *arguments, "--connect", endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
    )
    follows = "--joint-states" in arguments
    if follows:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("listening to /")
        process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=40)
    assert process.returncode == (-signal.SIGINT if follows else 0), errors
    assert errors == ("interrupted\n" if follows else "")
    return out


@pytest.mark.parametrize("line", LINES)
def test_every_documented_line(shared_server: ServerProcess, tmp_path: Path, line: str) -> None:
    with shared_server.connect() as tf:
        tf.reset()
    if line.startswith("zenoh-tf lookup"):
        run("zenoh-tf urdf robot.urdf", shared_server.endpoint, tmp_path)
    out = run(line, shared_server.endpoint, tmp_path)
    assert out
    if line == "zenoh-tf urdf robot.urdf":
        assert ("", out) in BLOCKS


def test_the_examples_of_the_help(shared_server: ServerProcess, tmp_path: Path) -> None:
    text = run("zenoh-tf urdf --help", shared_server.endpoint, tmp_path)
    examples = text.split("examples:\n")[1].strip().splitlines()
    assert len(examples) == 4
    for line in examples:
        assert run(line, shared_server.endpoint, tmp_path)


def test_every_count_is_on_the_page() -> None:
    names = {
        each.name for kind in (joint_states.Counts, kinematics.Counts) for each in fields(kind)
    }
    assert names <= set(re.findall(r"`(\w+)`", PAGE))
    assert f"{joint_states.MAX_JOINTS:,} joints" in PAGE
