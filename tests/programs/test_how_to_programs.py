"""The programs of docs/how-to/simulated-time.md and processes.md run, and calls hear Ctrl-C."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

from tests.conftest import ServerProcess
from tests.processes import forks

PAGES = Path(__file__).resolve().parents[2] / "docs/how-to"

CTRL_C = """
import os, signal, sys, threading, zenoh_tf
from zenoh_tf_client import TransformClient

link = zenoh_tf.StampedTransform("a", "b", 1, zenoh_tf.Transform())
if {embedded}:
    tree = zenoh_tf.TransformTree()
else:
    tree = TransformClient.connect(reads={reads!r})
tree.set_transform(link)
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    tree.lookup_transform("a", "b", 10**9, 600.0)
except KeyboardInterrupt:
    print("heard")
"""


def run(folder: Path, program: str, server: ServerProcess) -> str:
    (folder / "program.py").write_text(program)
    environment = {**os.environ, "ZENOH_TF_CONNECT": server.endpoint}
    command = [sys.executable, "program.py"]
    done = forks.run(command, timeout=150, cwd=folder, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize(
    ("page", "printed"),
    [
        ("simulated-time", r"StampedTransform\('map', 'base', stamp_ns=2000000000, .*\)\n"),
        ("processes", r"\[0\. 0\. 0\.\]\n"),
    ],
)
def test_a_program(server: ServerProcess, tmp_path: Path, page: str, printed: str) -> None:
    (program,) = re.findall(r"```py\n(.*?)```", (PAGES / f"{page}.md").read_text(), re.S)
    assert re.fullmatch(printed, run(tmp_path, program, server))


@pytest.mark.parametrize("reads", [None, "shared", "query"])
def test_a_lookup_that_waits_hears_ctrl_c(
    server: ServerProcess, tmp_path: Path, reads: str | None
) -> None:
    program = CTRL_C.format(embedded=reads is None, reads=reads)
    assert run(tmp_path, program, server) == "heard\n"
