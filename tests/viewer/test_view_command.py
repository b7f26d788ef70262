"""``zenoh-tf view`` as a process, with every command of docs/how-to/view.md."""

from __future__ import annotations

import json
import re
import shlex
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.processes import forks
from tests.processes.ports import free_port
from tests.processes.servers import ServerProcess
from tests.recordings.files import write
from zenoh_tf_tools.cli.main import main
from zenoh_tf_tools.cli.show.view import _EXAMPLES

PAGE = (Path(__file__).parents[2] / "docs/how-to/view.md").read_text()
MODULE = ("-m", "zenoh_tf_tools")
#: As the module, in a process that lacks a library.
WITHOUT = "import sys; sys.modules[sys.argv.pop(1)] = None; import zenoh_tf_tools.cli.main as m; "

Done = subprocess.CompletedProcess[str]


def run(*args: str, start: tuple[str, ...] = MODULE) -> Done:
    return forks.run([sys.executable, *start, *args], timeout=40)


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


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write(tmp_path_factory.mktemp("recording") / "run")
    return path.rename(path.with_name("run.mcap"))


def page(url: str) -> str:
    with urllib.request.urlopen(url, timeout=20) as reply:
        return str(reply.read(100_000).decode())


def test_it_serves_a_page_until_it_is_interrupted(recording: Path) -> None:
    port = free_port()
    with started("view", str(recording), "--port", str(port)) as (process, line):
        assert line == f"showing {recording} at http://127.0.0.1:{port} (Ctrl-C ends it)\n"
        assert "<html" in page(f"http://127.0.0.1:{port}")
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=20)
        assert process.returncode == -signal.SIGINT
        assert (output, errors) == ("", "interrupted\n")


def test_a_server_is_shown(server: ServerProcess) -> None:
    where = ("--connect", server.endpoint, "--port", str(free_port()), "--json")
    with started("view", *where) as (_, line):
        greeting = json.loads(line)
        assert greeting["showing"] == "main"
        assert "<html" in page(greeting["url"])


def test_a_port_that_is_taken(recording: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", free_port()))
        other.listen()
        port = other.getsockname()[1]
        with started("view", str(recording), "--port", str(port)) as (process, line):
            assert line == f"port {port} is not free\n"
            assert process.stdout is not None
            found = re.search(r"http://127.0.0.1:(\d+)", process.stdout.readline())
            assert found is not None
            assert found[1] != str(port)
            assert "<html" in page(found[0])


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (("view", "--port", "0"), 2, "'0' is not a whole number from 1 to 65,535"),
        (("view", "--stale", "x"), 2, "'x' is not a duration; give 20ms, 2s or 5min"),
        (("view", "--stale", "2"), 2, "--stale: '2' is ambiguous: 2 seconds or 2 milliseconds"),
        (("view", "--max-frames", "99999"), 2, "is not a whole number from 1 to 10,000"),
        (("view", "run", "--at", "-1"), 2, "--at: '-1' is ambiguous"),
        (("view", "nowhere.mcap"), 1, "nowhere.mcap: no such file"),
        (("view", "--connect", "tcp/127.0.0.1:9", "--timeout", "0.2s"), 1, "ServerUnavailable"),
    ],
)
def test_wrong_arguments(
    args: tuple[str, ...], code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status: object = main(args)
    except SystemExit as error:
        status = error.code
    assert status == code
    output, errors = capsys.readouterr()
    assert message in errors
    assert output == ""


def test_a_time_that_is_not_in_the_recording(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(recording), "--at", "1s"]) == 1
    assert "--at 1s is the stamp 1.000000000 s, but" in capsys.readouterr().err


def test_an_address_that_is_not_of_this_machine(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(recording), "--host", "203.0.113.1"]) == 1
    assert capsys.readouterr().err.startswith("zenoh-tf: cannot listen on '203.0.113.1': ")


def test_a_missing_library_is_named(recording: Path) -> None:
    done = run("viser", "view", str(recording), start=("-c", WITHOUT + "m.run()"))
    assert (done.returncode, done.stdout) == (1, "")
    assert "pip install 'zenoh-tf[viewer]'" in done.stderr


LINES = re.findall(r"^(zenoh-tf view.*?)(?: +#.*)?$", PAGE, re.MULTILINE)
HELP = _EXAMPLES


@pytest.mark.parametrize("line", sorted({*LINES, *HELP}))
def test_documented_lines(
    line: str, recording: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "run.mcap" not in line:
        monkeypatch.setenv("ZENOH_TF_CONNECT", request.getfixturevalue("server").endpoint)
    args = shlex.split(line)[1:]
    if "--port" not in args:
        args += ["--port", str(free_port())]
    with started(*args, cwd=recording.parent) as (_, first):
        assert first.startswith(("showing", "port"))


def test_the_page_and_the_help_have_lines() -> None:
    assert len(LINES) >= 3
    assert len(HELP) >= 3
