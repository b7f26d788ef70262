"""docs/tutorial/README.md: each command runs, in order, and prints what the page shows."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from typing import Any

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_port
from tests.support.command_line import shape

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = re.findall(r"```(sh|text)\n(.*?)```", (ROOT / "docs/tutorial/README.md").read_text(), re.S)
#: Commands that run until Ctrl-C; the page ends them where it says so.
UNTIL_CTRL_C = ("zenoh-tf-server", "python examples/sensor.py", "zenoh-tf view")
INSTALLATION = ("python3 -m venv ", ". build/", "pip install ")


def test_each_command_runs_and_prints_what_the_page_shows(
    start_server: StartServer, tmp_path: Path
) -> None:
    server = start_server()  # a frame's counters outlive the tests that share a server
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    environment = {**os.environ, "ZENOH_TF_CONNECT": server.endpoint}
    seen, shown, printed = set(), 0, ""
    sensor: forks.Popen | None = None

    def arguments(line: str) -> list[str]:
        program, *rest = shlex.split(line)
        if program == "python":
            return [sys.executable, *rest, "--connect", server.endpoint]
        assert program == "zenoh-tf"
        return [sys.executable, "-m", "zenoh_tf_tools", *rest]

    try:
        for kind, text in BLOCKS:
            if kind == "text":
                assert shape(printed) == shape(text)
                shown += 1
                continue
            for line in text.splitlines():
                seen.add(line)
                if line == "zenoh-tf-server" or line.startswith(INSTALLATION):
                    continue  # the fixture
                if line == "python examples/sensor.py":
                    sensor = forks.Popen(arguments(line), cwd=tmp_path)
                    with server.connect() as tf:
                        while not tf.can_transform("map", "camera"):
                            assert sensor.poll() is None
                            time.sleep(0.05)
                        newest_ns = tf.frame("base_link").newest_stamp_ns
                        assert newest_ns is not None
                        tf.lookup_transform("map", "camera", newest_ns + 10**9, 50.0)
                elif line == "zenoh-tf view":
                    _see_the_page([*arguments(line), "--port", str(free_port())], environment)
                else:
                    if line.startswith("zenoh-tf explain"):
                        assert sensor is not None
                        sensor.send_signal(signal.SIGINT)
                        sensor.wait(20)
                        time.sleep(
                            2
                        )  # as the page's reader: more than a second after its last sample
                    done = forks.run(arguments(line), timeout=150, cwd=tmp_path, env=environment)
                    faults = 3 if line.startswith("zenoh-tf doctor") else 0
                    assert done.returncode == faults, (line, done.stderr)
                    printed = done.stdout
                    if line.startswith(("zenoh-tf explain", "zenoh-tf doctor")):
                        assert "stopped" in printed
    finally:
        if sensor is not None and sensor.poll() is None:
            sensor.kill()
            sensor.wait()
    assert shown == 4
    assert seen > set(UNTIL_CTRL_C)


def test_the_readme_program_runs(server: Any) -> None:
    program = (ROOT / "examples/first.py").read_text()
    assert program.count("tcp/127.0.0.1:7447") == 1
    program = program.replace("tcp/127.0.0.1:7447", server.endpoint)
    done = forks.run([sys.executable, "-c", program], timeout=150)
    assert done.stdout == "one metre ahead of the camera: [3.2 1.  0.5]\n"


def _see_the_page(arguments: list[str], environment: dict[str, str]) -> None:
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, env=environment, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found
            with urllib.request.urlopen(found[0], timeout=20) as reply:
                assert b"<html" in reply.read(100_000)
        finally:
            process.kill()
