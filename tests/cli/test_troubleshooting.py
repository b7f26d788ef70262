"""docs/how-to/troubleshooting.md: its commands print what it shows, and its snippets run."""

from __future__ import annotations

import logging
import re
import shlex
from pathlib import Path

import pytest

from tests.processes.servers import ServerProcess
from tests.support.command_line import Run
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

PAGE = Path(__file__).resolve().parents[2] / "docs/how-to/troubleshooting.md"
BLOCKS: list[tuple[str, str]] = re.findall(r"```(\w+)\n(.*?)```", PAGE.read_text(), re.S)


@pytest.fixture(scope="module")
def simulated(shared_server: ServerProcess) -> ServerProcess:
    """A robot whose clock has reached 1010 s; its arm has stopped, and a name is misspelt."""
    with shared_server.connect() as tf:
        fill(tf)
    return shared_server


def fill(tf: TransformClient) -> None:
    for parent, child, authority, start_s, end_s, rate in (
        ("map", "odom", "localisation", 1000.0, 1009.9, 10),
        ("odom", "base_link", "wheels", 1000.02, 1010.0, 50),
        ("base_link", "gripper", "arm", 1000.0, 1006.0, 20),
    ):
        last = round((end_s - start_s) * rate)
        stamps = [round((end_s - n / rate) * 1e9) for n in range(last, -1, -1)]
        rows = [
            StampedTransform(parent, child, stamp_ns, Transform((stamp_ns / 1e10 - 100, 0, 0)))
            for stamp_ns in stamps
        ]
        tf.set_transforms_xact(rows, authority=authority)
    for parent, child, authority in (
        ("base_link", "camera", "mounts"),
        ("Camera", "lens", "calibration"),
    ):
        link = StampedTransform(parent, child, 0, Transform((0.1, 0, 0)))
        tf.set_transform(link, authority=authority, static=True)


def of_kind(kind: str) -> list[str]:
    return [text for language, text in BLOCKS if language == kind]


@pytest.mark.parametrize("block", of_kind("console"))
def test_commands_print_what_the_page_shows(
    simulated: ServerProcess, command: Run, block: str
) -> None:
    line, _, expected = block.partition("\n")
    program, *arguments = shlex.split(line.removeprefix("$ "))
    assert program == "zenoh-tf"
    ended = command("--connect", simulated.endpoint, *arguments)
    assert ended.stdout + ended.stderr == expected


@pytest.mark.parametrize("block", of_kind("sh"))
def test_other_commands_run(simulated: ServerProcess, command: Run, block: str) -> None:
    for line in block.splitlines():
        arguments = shlex.split(line)[1:]
        assert command("--connect", simulated.endpoint, *arguments).returncode == 0


@pytest.mark.parametrize("block", of_kind("python"))
def test_snippets_run(
    simulated: ServerProcess, block: str, caplog: pytest.LogCaptureFixture
) -> None:
    with simulated.connect() as tf:
        exec(block, {"tf": tf, "stamp_ns": 1008 * 10**9, "log": logging.getLogger("test")})
    if "log.warning" in block:
        assert "gripper: " in caplog.text


def test_every_block_is_of_a_kind_that_is_run() -> None:
    assert {language for language, _ in BLOCKS} == {"console", "sh", "python"}
