"""``zenoh-tf view`` as a process, with every command of docs/how-to/view.md."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import signal
import socket
import urllib.request
from pathlib import Path

import pytest

from tests.processes.ports import free_port
from tests.processes.servers import ServerProcess
from tests.recordings.files import write
from tests.support.command_line import call, documented, run_without, started

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/how-to/view.md"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write(tmp_path_factory.mktemp("recording") / "run")
    shutil.copy(ROOT / "examples/arm.urdf", path.with_name("robot.urdf"))
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
        (("view", "--at", "+1s"), 2, "--at chooses a time of a recording: give its FILE"),
        (("view", "nowhere.mcap"), 1, "nowhere.mcap: no such file"),
        (("view", "--connect", "tcp/127.0.0.1:9", "--timeout", "0.2s"), 1, "ServerUnavailable"),
    ],
)
def test_wrong_arguments(
    args: tuple[str, ...], code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    done = call(capsys, *args)
    assert (done.returncode, done.stdout) == (code, "")
    assert message in done.stderr


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--at", "1s"), "--at 1s is the stamp 1.000000000 s, but"),
        (("--host", "203.0.113.1"), "zenoh-tf: cannot listen on '203.0.113.1': "),
        (("--urdf", "nowhere.urdf"), "zenoh-tf: nowhere.urdf: No such file or directory"),
        (("--urdf", "run.mcap"), "run.mcap: not XML"),
    ],
)
def test_arguments_that_do_not_fit(
    recording: Path,
    args: tuple[str, str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(recording.parent)
    done = call(capsys, "view", str(recording), *args)
    assert done.returncode == 1
    assert message in done.stderr


@pytest.mark.parametrize(
    ("extra", "library", "args"),
    [
        ("viewer", "viser", ("view",)),
        ("plot", "matplotlib", ("plot", "map", "base")),
        ("foxglove", "foxglove", ("foxglove",)),
    ],
)
def test_a_missing_library_is_named(extra: str, library: str, args: tuple[str, ...]) -> None:
    done = run_without(library, *args)
    assert (done.returncode, done.stdout) == (1, "")
    assert f"pip install 'zenoh-tf[{extra}]'" in done.stderr


@pytest.mark.parametrize("line", documented(PAGE, "view"))
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
