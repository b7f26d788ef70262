"""docs/how-to/urdf.md and the help of the command say what is so: every line runs."""

from __future__ import annotations

import contextlib
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import forks
from tests.processes.servers import ServerProcess

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/how-to/urdf.md").read_text()
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.M | re.S)
LINES = [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()]
#: Those that need each other.
TRY_IT = [
    line
    for kind, block in BLOCKS
    if kind == "sh" and "python" in block
    for line in block.splitlines()
]
ALONE = [line for line in LINES if line not in TRY_IT]


def start(line: str, endpoint: str, folder: Path) -> subprocess.Popen[str]:
    command, *arguments = shlex.split(line)
    if command == "zenoh-tf":
        arguments = ["-m", "zenoh_tf_tools", *arguments]
    else:
        assert command == "python"
    shutil.copy(ROOT / "examples/arm.urdf", folder / "robot.urdf")
    with contextlib.suppress(FileExistsError):
        (folder / "examples").symlink_to(ROOT / "examples")
    return forks.Popen(
        [sys.executable, *arguments, "--connect", endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=folder,
    )


def run(line: str, endpoint: str, folder: Path) -> str:
    """What a line prints; one that follows a robot is interrupted."""
    process = start(line, endpoint, folder)
    follows = "--joint-states" in line
    if follows:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("listening to /")
        process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=150)
    assert process.returncode == (-signal.SIGINT if follows else 0), errors
    assert errors == ("interrupted\n" if follows else "")
    return out


def test_every_line_is_run() -> None:
    assert len(LINES) == len({*LINES}) == len({*ALONE, *TRY_IT}) == 10


@pytest.mark.parametrize("line", ALONE)
def test_a_line_alone(shared_server: ServerProcess, tmp_path: Path, line: str) -> None:
    with shared_server.connect() as tf:
        tf.reset()
    if line.startswith("zenoh-tf lookup"):
        run("zenoh-tf urdf robot.urdf", shared_server.endpoint, tmp_path)
    out = run(line, shared_server.endpoint, tmp_path)
    assert out
    if line == "zenoh-tf urdf robot.urdf":
        assert ("", out) in BLOCKS


def test_without_a_robot(shared_server: ServerProcess, tmp_path: Path) -> None:
    """An emulated arm, the command that follows it, and a question about both."""
    *background, question = TRY_IT
    with shared_server.connect() as tf:
        tf.reset()
        running = [start(line, shared_server.endpoint, tmp_path) for line in background]
        while not tf.can_transform("base", "tool", timeout_s=1.0):
            assert all(process.poll() is None for process in running)
        assert str(tf.frame("knuckle").authority).startswith("urdf/ros2:0/joint_states#")
    assert run(question, shared_server.endpoint, tmp_path).startswith("tool in base\n")
    for process in running:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=150)
        assert process.returncode in (0, -signal.SIGINT), errors


def test_the_examples_of_the_help(shared_server: ServerProcess, tmp_path: Path) -> None:
    text = run("zenoh-tf urdf --help", shared_server.endpoint, tmp_path)
    examples = text.split("examples:\n")[1].strip().splitlines()
    assert len(examples) == 4
    for line in examples:
        assert run(line, shared_server.endpoint, tmp_path)


def test_the_python_example_runs(tmp_path: Path) -> None:
    (block,) = (block for kind, block in BLOCKS if kind == "py")
    shutil.copy(ROOT / "examples/arm.urdf", tmp_path / "robot.urdf")
    done = forks.run([sys.executable, "-c", block], cwd=tmp_path, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "tool" in done.stdout
