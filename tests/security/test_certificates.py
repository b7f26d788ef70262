"""``zenoh-tf certificates``, and the commands that it prints."""

from __future__ import annotations

import json
import shlex
import ssl
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes import forks

from .conftest import tls_endpoint

pytest.importorskip("cryptography")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return forks.run(
        [sys.executable, "-m", "zenoh_tf_tools", *arguments],
        timeout=50,
    )


def test_the_printed_commands_work(tmp_path: Path, start_server: StartServer) -> None:
    folder = tmp_path / "my trial"
    made = run("certificates", str(folder), "--host", "127.0.0.1", "localhost", "--client", "nav")
    assert made.returncode == 0, made.stderr
    server_line, client_line = (line for line in made.stdout.splitlines() if line[:2] == "  ")
    endpoint = tls_endpoint()
    program, listen, where, *flags = shlex.split(server_line)
    assert (program, listen) == ("zenoh-tf-server", "--listen")
    start_server(*flags, endpoint=endpoint)
    program, connect, where, *flags = shlex.split(client_line)
    assert (program, connect, where) == ("zenoh-tf", "--connect", "tls/127.0.0.1:7447")
    done = run("--connect", endpoint, *flags)
    assert (done.returncode, done.stderr) == (0, "")


def test_keys_are_for_their_owner_only_and_nothing_is_overwritten(tmp_path: Path) -> None:
    first = run("certificates", str(tmp_path), "--host", "robot", "--json")
    assert json.loads(first.stdout)["certificates"]["server"]["key"].endswith("server-key.pem")
    content = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for path in tmp_path.iterdir():
        expected = 0o600 if "key" in path.name else 0o644
        assert stat.S_IMODE(path.stat().st_mode) == expected, path
    again = run("certificates", str(tmp_path), "--host", "robot")
    assert again.returncode == 1 and "is there already" in again.stderr
    assert run("certificates", str(tmp_path), "--client", "late").returncode == 0
    for name, old in content.items():
        assert (tmp_path / name).read_bytes() == old
    context = ssl.create_default_context(cafile=str(tmp_path / "ca.pem"))
    context.load_cert_chain(tmp_path / "late.pem", tmp_path / "late-key.pem")


@pytest.mark.parametrize(
    "arguments",
    [["--client", "../up"], ["--client", ""], ["--client", "x" * 65], ["--host", "höst"]],
)
def test_names_that_cannot_be(tmp_path: Path, arguments: list[str]) -> None:
    done = run("certificates", str(tmp_path / "d"), *arguments)
    assert done.returncode == 1 and done.stderr.startswith("zenoh-tf: ")
    assert {path.name for path in (tmp_path / "d").iterdir()} == {"ca.pem", "ca-key.pem"}
