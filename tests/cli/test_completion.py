"""``zenoh-tf completion``: commands, options and frames, as a shell completes them."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.processes.servers import ServerProcess
from tests.support.command_line import Run
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session import environment
from zenoh_tf_tools.cli import completion

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


class Bash:
    """A shell that has the script, with a time-out that no slow machine exceeds."""

    def __init__(self, script: str, folder: Path) -> None:
        self.program = folder / "zenoh-tf"
        self.patience(60.0)
        self._script = script

    def patience(self, timeout_s: float) -> None:
        """Let the program wait so long for the names."""
        self.program.write_text(
            f"#!{sys.executable}\n"
            "from zenoh_tf_tools.cli import completion, main\n"
            f"completion._TIMEOUT_S = {timeout_s}\n"
            "main.run()\n"
        )
        self.program.chmod(0o755)

    def completes(self, *words: str, **environment: str) -> list[str]:
        """What it offers for the last of these words of a command line."""
        complete = (
            'COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; '
            '_shtab_zenoh_tf zenoh-tf "${@: -1}" ""; printf "%s\\n" "${COMPREPLY[@]}"'
        )
        done = subprocess.run(
            ["bash", "-c", f"{self._script}\n{complete}", "bash", str(self.program), *words],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
            env={**os.environ, **environment},
        )
        assert done.stderr == ""
        return done.stdout.split()


@pytest.fixture
def bash(command: Run, tmp_path: Path) -> Bash:
    pytest.importorskip("shtab")
    return Bash(command("completion", "bash").stdout, tmp_path)


@pytest.fixture
def elsewhere(server: ServerProcess) -> Iterator[ServerProcess]:
    """Another server, with a frame of its own, and with names that a shell could misread."""
    with server.connect() as tf:
        for child in ("dock", "$(touch hacked)", "two words", "a;b", "größe"):
            tf.set_transform(StampedTransform("hall", child, 0, Transform()), static=True)
        yield server
        tf.reset()


@needs_bash
def test_commands_and_options_in_bash(bash: Bash) -> None:
    assert bash.completes("exp") == ["explain"]
    assert "--ignore" in bash.completes("doctor", "--")


@needs_bash
def test_frames_in_bash(robot: TransformClient, bash: Bash) -> None:
    frames = ["base_link", "camera", "gripper", "map", "odom"]
    assert bash.completes("latest", "") == frames
    assert {*frames, "pyproject.toml"} <= {*bash.completes("lookup", "")}  # or a recording
    assert bash.completes("lookup", "map", "g") == ["gripper"]
    assert bash.completes("frame", "ca") == ["camera"]
    assert bash.completes("velocity", "base_link", "map", "--reference", "od") == ["odom"]
    assert bash.completes("monitor", "--pair", "map", "b") == ["base_link"]
    assert bash.completes("query", "run.mcap", "") == []  # those of the recording, not of a server


@needs_bash
def test_frames_of_the_server_that_the_line_names(
    robot: TransformClient, elsewhere: ServerProcess, bash: Bash, tmp_path: Path
) -> None:
    for option in (["--connect", elsewhere.endpoint], [f"--connect={elsewhere.endpoint}"]):
        # Other names than plain ones are left out, or the shell would run or split them.
        assert bash.completes(*option, "latest", "") == ["dock", "größe", "hall"]
    bash.patience(0.5)
    assert bash.completes("--connect", elsewhere.endpoint, "--tree", "x", "latest", "") == []
    assert not (tmp_path / "hacked").exists()


@needs_bash
def test_no_frames_without_a_server(bash: Bash) -> None:
    """Neither names nor an error: also if something listens that does not answer."""
    bash.patience(0.5)
    nobody = {environment.ENDPOINT_VARIABLE: "tcp/127.0.0.1:9"}
    assert bash.completes("latest", "", **nobody) == []
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        assert bash.completes("latest", "", **{environment.ENDPOINT_VARIABLE: endpoint}) == []


def test_whatever_the_line_is(
    robot: TransformClient, command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(completion, "_TIMEOUT_S", 60.0)
    for line in ("zenoh-tf lookup 'ma", "zenoh-tf --tree", "zenoh-tf --timeout x lookup", ""):
        done = command("completion", "frames", f"--line={line}")
        assert done.returncode == 0
        assert done.stdout in ("", "base_link\ncamera\ngripper\nmap\nodom\n")
    assert command("completion", "frames", "--tls-ca", "/nowhere").stdout == ""


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_ask_for_frames(command: Run, shell: str) -> None:
    pytest.importorskip("shtab")
    assert "completion frames" in command("completion", shell).stdout
    if shutil.which(shell):
        check = subprocess.run(
            [shell, "-f", "-n"] if shell == "zsh" else [shell, "-f"],
            input=command("completion", shell).stdout,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert (check.returncode, check.stderr) == (0, "")


def test_completion_without_its_library(command: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    ended = command("completion", "zsh")
    assert (ended.returncode, ended.stdout) == (1, "")
    assert "pip install 'zenoh-tf[completion]'" in ended.stderr
