"""Every command has examples in its --help, and each of them works."""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path

import pytest

from tests.recordings.files import Log, write
from tests.support.command_line import Run, parsers
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.main import _for_argparse, _parser


def examples(parser: argparse.ArgumentParser) -> list[list[str]]:
    """The arguments of `zenoh-tf` in each example."""
    lines = re.findall(r"zenoh-tf ([^|&>)\n]*)", (parser.epilog or "").partition("examples:")[2])
    return [shlex.split(line, comments=True) for line in lines]


PAGE = Path(__file__).resolve().parents[2] / "docs/reference/commands.md"
ALL = dict(parsers())
#: These have tests of their own, which make the files and servers that they need.
ELSEWHERE = (
    "calibration",
    "foxglove",
    "rerun",  # a window
    "plot",
    "query",
    "record",
    "replay",
    "urdf",
    "view",
)
#: After these the tree is another one.
LAST = ("remove", "clear", "reset")
RUNNABLE = sorted(
    (
        line
        for prog, parser in ALL.items()
        if prog.split()[1] not in ELSEWHERE
        for line in examples(parser)
        if not any(word.endswith(".mcap") for word in line)
    ),
    key=lambda line: LAST.index(line[0]) if line[0] in LAST else -1,
)


def test_every_command_has_an_example() -> None:
    whole = _parser()
    for prog, parser in ALL.items():
        assert examples(parser), prog
        for line in examples(parser):
            # Wrong usage would end the process.
            whole.parse_args(_for_argparse(line))


def test_no_command_is_left_out() -> None:
    names = {prog.split()[1] for prog in ALL}
    assert {line[0] for line in RUNNABLE} == names - set(ELSEWHERE)


@pytest.fixture
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder that commands run in has a recording."""
    log: Log = [(i / 50, "/tf", [("map", "base_link", 9.0 + i / 50, i / 50)]) for i in range(1001)]
    write(tmp_path / "log", log).rename(tmp_path / "run.mcap")
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("in_folder")
def test_the_examples_run(robot: TransformClient, command: Run) -> None:
    run_all(RUNNABLE, command)


@pytest.mark.usefixtures("in_folder")
def test_the_page_about_commands(robot: TransformClient, command: Run) -> None:
    """Its lines run in order."""
    blocks = "".join(re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.S))
    lines = [shlex.split(line, comments=True)[1:] for line in blocks.splitlines()]
    run_all(lines, command)


def run_all(lines: list[list[str]], command: Run) -> None:
    for line in lines:
        endless = line[0] in ("echo", "monitor", "top") and "--count" not in line
        # The last one counts.
        period = ["--every", "0.1s"]
        short = {"doctor": ["--for", "0.1s"], "monitor": period, "top": period}
        ended = command(*line, *short.get(line[0], []), *(["--count", "1"] if endless else []))
        if line[0] == "doctor":  # the samples of this tree are ahead of the clock
            assert (ended.returncode, ended.stderr) == (3, ""), line
            assert "TF202" in ended.stdout
        else:
            assert (ended.returncode, ended.stderr) == (0, ""), (line, ended)
        assert ended.stdout, line
