"""docs/how-to/from-tf2.md says what is so: its commands, imports and scripts run."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.processes import forks
from zenoh_tf import StampedTransform, Transform

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/how-to/from-tf2.md").read_text()
CODE = [code.strip() for code in re.findall(r"`([^`\n]+)`", PAGE)]
EXAMPLE = ROOT / "examples/from_tf2.py"
FILTER_EXAMPLE = ROOT / "examples/message_filter.py"


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return forks.run([sys.executable, *command], timeout=150)


@pytest.mark.parametrize("connects", [False, True])
def test_the_example_runs(shared_server: Any, connects: bool) -> None:
    done = run(EXAMPLE, *(["--connect", shared_server.endpoint] if connects else []))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "base_link at Vector3(x=2.0, y=0.0, z=0.0)\n"


def test_the_first_lines_run() -> None:
    first = re.search(r"```python\n(from zenoh_tf.*?)```", PAGE, re.S)
    assert first is not None
    done = run("-c", first[1] + "print(buffer.is_on_server)")
    assert (done.returncode, done.stdout) == (0, "False\n"), done.stderr


def test_the_example_of_a_filter_runs() -> None:
    done = run(FILTER_EXAMPLE)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"It prints\n\n```\n{done.stdout}```\n" in PAGE


IMPORTS = [code for code in CODE if "zenoh_tf.tf2" in code and "import" in code]


def test_every_import_works() -> None:
    assert len(IMPORTS) == 7
    for line in IMPORTS:
        exec(line, {})


COMMANDS = [code for code in CODE if code.startswith("zenoh-tf ")]


def test_every_command_runs(shared_server: Any) -> None:
    assert len(COMMANDS) == 7
    with shared_server.connect() as tf:
        tf.set_transform(StampedTransform("map", "base_link", 1, Transform()), "wheels")
    for command in sorted({*COMMANDS, "zenoh-tf frames --dot"}):
        words = shlex.split(command)[1:]
        if words[0] in ("replay", "static"):  # a recording that is not here; no arguments
            words[1:] = ["--help"]
        if words[0] in ("echo", "monitor", "top"):  # they continue
            words += ["--count", "1"]
        done = run("-m", "zenoh_tf_tools", "--connect", shared_server.endpoint, *words)
        assert (done.returncode, done.stderr) == (0, ""), command
        assert done.stdout, command
