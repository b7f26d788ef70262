"""The command line as tests call it: in this process, or as a process of its own."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.processes import forks
from zenoh_tf_tools.cli.main import _parser, main

MODULE = ("-m", "zenoh_tf_tools")
Done = subprocess.CompletedProcess[str]
Run = Callable[..., Done]


def call(capsys: pytest.CaptureFixture[str], *args: str) -> Done:
    """One command in this process, to its end, which is much quicker."""
    try:
        code = main(args)
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    return Done(args, code, *capsys.readouterr())


def run(*args: str) -> Done:
    """One command as a process, to its end."""
    return forks.run([sys.executable, *MODULE, *args], timeout=150)


def begun(*args: str, cwd: Path | None = None) -> forks.Popen:
    """One command as a process that runs on, whose output is piped."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return forks.Popen([sys.executable, *MODULE, *args], **pipes, cwd=cwd)


def run_without(library: str, *args: str) -> Done:
    """`run` where a library is not installed."""
    code = f"import sys; sys.modules[{library!r}] = None; from zenoh_tf_tools.cli.main import run; "
    return forks.run([sys.executable, "-c", code + "run()", *args], timeout=150)


@contextmanager
def started(*args: str, cwd: Path | None = None) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A command that runs until Ctrl-C, and its first line."""
    with subprocess.Popen(
        [sys.executable, *MODULE, *args],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=cwd,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            line = process.stdout.readline()
            assert line, process.stderr.read()
            yield process, line
        finally:
            process.kill()


def parsers(
    parser: argparse.ArgumentParser | None = None,
) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """All commands with their parsers, such as ``zenoh-tf calibration save``."""
    for action in (parser or _parser())._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield child.prog, child
                yield from parsers(child)


def documented(page: Path, name: str) -> list[str]:
    """The calls of a command on a page and in its help; both have some."""
    epilog = dict(parsers())[f"zenoh-tf {name}"].epilog or ""
    pattern = rf"^ *(zenoh-tf {name}\b.*?)(?: +#.*)?$"
    on_page, in_help = (re.findall(pattern, text, re.M) for text in (page.read_text(), epilog))
    assert on_page and in_help
    return sorted({*on_page, *in_help})


def shape(output: str) -> list[list[str]]:
    """The words of each line; numbers and the width of columns do not count."""
    output = re.sub(r"-?\d+\.?\d*(e-?\d+)?", "0", output)
    output = re.sub(r"0 (ms|us|s) ago", "0 s ago", re.sub(r"[\[\]]", " ", output))
    return [line.split() for line in output.splitlines()]
