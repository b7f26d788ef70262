"""docs/tutorial/python.md and recording.md: what they say to run runs, and prints what they show.

tests/ros2/test_page.py is about docs/tutorial/ros2.md.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from pathlib import Path

from tests.conftest import ServerProcess
from tests.processes import forks
from tests.support.command_line import shape

ROOT = Path(__file__).resolve().parents[2]


class Page:
    """A page, whose files are written and whose commands run in a folder with the examples."""

    def __init__(self, name: str, folder: Path, endpoint: str) -> None:
        self.text = (ROOT / "docs/tutorial" / f"{name}.md").read_text()
        (folder / "build").mkdir()
        (folder / "examples").symlink_to(ROOT / "examples")
        blocks = re.findall(r"^```(\w+)\n(.*?)^```$", self.text, re.M | re.S)
        self.shown = [text for kind, text in blocks if kind == "text"]
        names = re.findall(r"as `(build/\w+\.py)`", self.text)
        programs = [text for kind, text in blocks if kind == "py"]
        for program, text in zip(names, programs, strict=True):
            (folder / program).write_text(text)
            assert f"`python {program}`" in self.text
        lines = [line for kind, text in blocks if kind == "sh" for line in text.splitlines()]
        installation, *self.lines = lines
        assert "&& pip install " in installation
        self._folder = folder
        self._environment = {**os.environ, "ZENOH_TF_CONNECT": endpoint}

    def start(self, line: str) -> forks.Popen:
        return forks.Popen(self._command(line), cwd=self._folder, env=self._environment)

    def run(self, line: str) -> str:
        command = self._command(line.partition(" > ")[0])
        done = forks.run(command, timeout=150, cwd=self._folder, env=self._environment)
        assert done.returncode == 0, (line, done.stderr)
        return done.stdout

    def _command(self, line: str) -> list[str]:
        assert line in self.text
        program, *arguments = shlex.split(line)
        if program == "zenoh-tf":
            return [sys.executable, "-m", "zenoh_tf_tools", *arguments]
        assert program == "python"
        if arguments[0].startswith("examples/"):
            arguments += ["--connect", self._environment["ZENOH_TF_CONNECT"]]
        return [sys.executable, *arguments]


def wait_for(server: ServerProcess, target: str, source: str, program: forks.Popen) -> None:
    with server.connect() as tf:
        while not tf.can_transform(target, source, timeout_s=1.0):
            assert program.poll() is None
        since_ns = tf.lookup_transform(target, source).stamp_ns
        tf.lookup_transform(target, source, since_ns + 1_500_000_000, 100.0)


def test_plain_python(server: ServerProcess, tmp_path: Path) -> None:
    page = Page("python", tmp_path, server.endpoint)
    assert page.lines == []
    (printed,) = page.shown
    assert page.run("python build/robot.py") == printed
    mover = page.start("python build/move.py")
    try:
        wait_for(server, "base", "tool", mover)
        assert page.run("zenoh-tf lookup base tool").startswith("tool in base\n")
    finally:
        mover.kill()
        mover.wait()


def test_a_recording(server: ServerProcess, tmp_path: Path) -> None:
    page = Page("recording", tmp_path, server.endpoint)
    what, *poses = page.lines
    tree, moved = page.shown
    sensor = page.start("python examples/sensor.py")
    try:
        wait_for(server, "map", "camera", sensor)
        page.run("zenoh-tf record run.mcap --for 3s")
    finally:
        sensor.kill()
        sensor.wait()
    assert shape(page.run(what)) == shape(tree)
    at, table = poses
    assert page.run(at).startswith("camera in map\n")
    header, *rows = page.run(table).splitlines()
    assert header.startswith("stamp_ns,x,") and len(rows) > 10
    assert shape(page.run("python build/path.py")) == shape(moved)
    page.run("zenoh-tf doctor run.mcap")
    page.run("zenoh-tf explain run.mcap map camera")
