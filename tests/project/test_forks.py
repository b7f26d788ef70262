"""Forked processes behave as new interpreters do."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import forks

SHOW = """
import os, sys
print(sys.argv[1:], os.getcwd(), os.environ.get("COLOUR"), input())
print("to errors", file=sys.stderr)
sys.exit(int(sys.argv[1]))
"""


def test_arguments_folder_environment_streams_and_exit(tmp_path: Path) -> None:
    environment = os.environ | {"COLOUR": "green"}
    command = [sys.executable, "-c", SHOW, "3"]
    here = forks.run(command, input="line", cwd=tmp_path, env=environment)
    assert here.returncode == 3
    assert here.stdout == f"['3'] {tmp_path} green line\n"
    assert here.stderr == "to errors\n"


def test_an_exception_is_reported_and_has_status_1() -> None:
    done = forks.run([sys.executable, "-c", "raise ValueError(7)"])
    assert done.returncode == 1
    assert done.stderr.endswith("ValueError: 7\n")


def test_a_file_and_a_module(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text("import sys; print(__name__, sys.argv)")
    file = tmp_path / "program.py"
    assert forks.run([sys.executable, file, "a"]).stdout == f"__main__ ['{file}', 'a']\n"
    assert "usage: zenoh-tf" in forks.run([sys.executable, "-m", "zenoh_tf_tools", "-h"]).stdout


def test_one_that_runs_on_is_killed() -> None:
    command = [sys.executable, "-c", "import time; print('begun', flush=True); time.sleep(100)"]
    with forks.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        assert process.poll() is None
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.01)
        process.kill()
        assert process.wait(20) == -signal.SIGKILL


def test_other_settings_of_the_interpreter_need_a_new_one() -> None:
    script = "import os, sys; print(sys.flags.utf8_mode, os.getppid())"
    environment = os.environ | {"PYTHONUTF8": "1"}
    done = forks.run([sys.executable, "-c", script], env=environment)
    assert done.stdout == f"1 {os.getpid()}\n"
