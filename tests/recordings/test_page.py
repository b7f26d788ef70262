"""Every command and every snippet of docs/recordings.md runs."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree

from .files import Log, write

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/recordings.md").read_text()
COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S)
    for line in block.splitlines()
    if not line.startswith("pip ")
]
#: 20 s of a camera on a robot that moves at 1 m/s.
RUN: Log = [
    (5.0, "/tf_static", [("base", "camera", 0.0, 0.2)]),
    *[(5.0 + i / 50, "/tf", [("map", "base", 100.0 + i / 50, i / 50)]) for i in range(1001)],
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path / "log", RUN).rename(tmp_path / "run.mcap")
    return tmp_path


def test_every_command_runs(server: Any, folder: Path) -> None:
    with server.connect() as tf:
        tf.set_transform(StampedTransform("map", "base", 1, Transform((1, 0, 0))))
        environment = {**os.environ, "ZENOH_TF_CONNECT": server.endpoint}
        for line in COMMANDS:
            command, _, out = line.partition(" > ")
            program, *arguments = shlex.split(command)
            assert program == "zenoh-tf"
            done = subprocess.run(
                [sys.executable, "-m", "zenoh_tf_client", *arguments],
                capture_output=True,
                text=True,
                timeout=50,
                check=False,
                cwd=folder,
                env=environment,
            )
            assert done.returncode == 0, (line, done.stderr)
            if out:
                (folder / out).write_text(done.stdout)
    assert len((folder / "camera.csv").read_text().splitlines()) == 1002
    assert np.load(folder / "camera.npz")["translations"].shape == (1001, 3)
    for name in ("cell.mcap", "cell-ros.mcap"):
        assert TransformTree.from_recording(folder / name).frames()


def test_the_page_has_commands_to_check() -> None:
    assert {line.split()[1] for line in COMMANDS} == {"query", "record", "replay"}
    assert len(COMMANDS) >= 9


def test_the_snippet_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (snippet,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    found: dict[str, Any] = {}
    exec(snippet, found)
    assert found["path"].shape == (250, 3)
    np.testing.assert_allclose(found["speeds"], 1.0, atol=1e-6)


@pytest.mark.parametrize("command", ["query", "record", "replay"])
def test_help_has_examples_that_parse(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    from zenoh_tf_client.cli.main import _parser  # noqa: PLC0415

    with pytest.raises(SystemExit):
        _parser().parse_args([command, "--help"])
    examples = re.findall(r"^  zenoh-tf (.*)$", capsys.readouterr().out, re.M)
    assert examples
    for example in examples:
        arguments = _parser().parse_args(shlex.split(example.partition(" > ")[0]))
        assert callable(arguments.run)
