"""Every command and every snippet of docs/how-to/recordings.md runs."""

from __future__ import annotations

import re
import shlex
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.command_line import begun, call, parsers, run
from zenoh_tf import StampedTransform, Transform, TransformTree

from .files import Log, write

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/how-to/recordings.md").read_text()
COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S)
    for line in block.splitlines()
    if not line.startswith("pip ")
]
#: 20 s of a camera on a robot that moves at 1 m/s.
RUN: Log = [
    (99.0, "/tf_static", [("base", "camera", 0.0, 0.2)]),
    *[(100.05 + i / 50, "/tf", [("map", "base", 100.0 + i / 50, i / 50)]) for i in range(1001)],
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path / "log", RUN).rename(tmp_path / "run.mcap")
    for name, topics in (("drive", ("/tf", "/tf_gt")), ("fleet", ("/robot1/tf", "/robot2/tf"))):
        log = [(1.0, topic, [("odom", "base_link", 1.0, 0.0)]) for topic in topics]
        write(tmp_path / "several", log).rename(tmp_path / f"{name}.mcap")
        shutil.rmtree(tmp_path / "several")
    return tmp_path


def test_every_command_runs(
    server: Any, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    with server.connect() as tf:
        tf.set_transform(StampedTransform("map", "base", 1, Transform((1, 0, 0))))
        for line in COMMANDS:
            command, _, out = line.partition(" > ")
            program, name, *arguments = shlex.split(command)
            assert program == "zenoh-tf"
            # The last one counts. `record` handles signals, so it has a process of its own.
            short = {"record": ["--for", "0.2s"], "replay": ["--rate", "1000"]}.get(name, [])
            done = (
                run(name, *arguments, *short)
                if name == "record"
                else call(capsys, name, *arguments, *short)
            )
            assert done.returncode == 0, (line, done.stderr)
            if out:
                (folder / out).write_text(done.stdout)
    assert len((folder / "camera.csv").read_text().splitlines()) == 1002
    assert TransformTree.from_recording(folder / "cell.mcap").frames()


def test_the_page_has_commands_to_check() -> None:
    assert {line.split()[1] for line in COMMANDS} == {"query", "estimate", "record", "replay"}
    assert len(COMMANDS) >= 7


def test_the_snippet_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (snippet,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    found: dict[str, Any] = {}
    exec(snippet, found)
    assert found["path"].shape == (250, 3)
    np.testing.assert_allclose(found["speeds"], 1.0, atol=1e-6)


def test_every_example_of_query_runs(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    for line in examples_of("query"):
        done = call(capsys, *line)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout


@pytest.mark.parametrize("command", ["record", "replay"])
def test_every_example_of_the_help_runs(server: Any, folder: Path, command: str) -> None:
    """Those that would run for long are ended by Ctrl-C."""
    if command == "record":  # it makes the file
        (folder / "run.mcap").unlink()
    for line in examples_of(command):
        with begun("--connect", server.endpoint, *line, cwd=folder) as process:
            if command == "record" or "--loop" in line:
                with server.connect() as tf:
                    # By then it ends well by Ctrl-C.
                    while not (folder / "run.mcap").exists() or (
                        # The loop's stamps are of now, those of the other examples are not.
                        command == "replay" and (tf.frame("base").newest_stamp_ns or 0) < 10**18
                    ):
                        assert process.poll() is None
                        time.sleep(0.05)
                process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=150)
        if "--loop" in line:
            assert err == "interrupted\n"
        else:
            assert process.returncode == 0, (line, err)
            assert out, line
        if command == "record":
            (folder / "run.mcap").unlink()


def examples_of(command: str) -> list[list[str]]:
    epilog = dict(parsers())[f"zenoh-tf {command}"].epilog or ""
    found = [shlex.split(line) for line in re.findall(r"zenoh-tf ([^>\n]*)", epilog)]
    assert len(found) >= 2
    return found
