"""How commands fail, and stamps and encodings that they used to fail on."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
import time
from typing import Any

import pytest

from tests.processes import forks
from tests.support.command_line import Run
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

from .conftest import document, refusal, succeeds


@pytest.mark.parametrize("stamp", [["--stamp", "-1s"], ["--stamp=-1s"], ["--stamp", "now-1s"]])
def test_a_stamp_before_now(run: Run, stamp: list[str]) -> None:
    before_ns = time.time_ns()
    done = document(run("set", "map", "base", "0", "0", "-1", *stamp, "--json"))
    assert before_ns <= done["stamp_ns"] + 10**9 <= time.time_ns()
    line = refusal(run("lookup", "map", "base", "--at", "-100s"))
    assert "NoDataForExtrapolationException" in line


def test_a_stamp_after_now(run: Run) -> None:
    succeeds(run("set", "map", "base", "0", "0", "0", "--stamp", "now+100s"))
    text = succeeds(run("lookup", "map", "base"))
    assert re.search(r"  time         \d+\.\d{9} s  \(in \d\d\.\d s\)\n", text)
    assert re.search(r"newest       .*\(in ", succeeds(run("frame", "base")))


def json_error(done: subprocess.CompletedProcess[str], code: int = 1) -> dict[str, Any]:
    """The one JSON object that a failed command with --json prints."""
    assert done.returncode == code
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    error: dict[str, Any] = json.loads(done.stderr)
    assert set(error) == {"type", "message", "fields"}
    return error


@pytest.mark.usefixtures("chain")
def test_errors_as_json(run: Run) -> None:
    error = json_error(run("--json", "lookup", "map", "base", "--at", "99s"))
    assert error["type"] == "ForwardExtrapolationException"
    assert "97.0 s too late" in error["message"]
    assert (error["fields"]["stamp_ns"], error["fields"]["frame"]) == (99 * 10**9, "base")
    assert error["fields"]["newest_stamp_ns"] == 2 * 10**9

    succeeds(run("set", "map", "base", "0", "0", "0", "--stamp", "1000s"))
    error = json_error(run("set", "map", "base", "0", "0", "0", "--stamp", "1s", "--json"))
    assert error["type"] == "CommandError"
    assert "dropped" in error["message"]

    error = json_error(run("set", "map", "base", "0", "0", "--json"), code=2)
    assert (error["type"], error["message"]) == ("UsageError", "a pose is 3 or 7 numbers, not 2")
    error = json_error(run("--json", "lookup", "map"), code=2)
    assert (error["type"], error["fields"]) == ("UsageError", {})


def test_no_server_as_json(zenoh_tf: Run) -> None:
    command = ("--json", "--connect", "tcp/127.0.0.1:9", "--timeout", "0.5s", "frames")
    assert json_error(zenoh_tf(*command))["type"] == "ServerUnavailable"


@pytest.mark.usefixtures("chain")
def test_output_in_ascii(
    run: Run, client: TransformClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.set_transform(StampedTransform("base", "größe", 0, Transform()), static=True)
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    _, *lines = succeeds(run("frames")).splitlines()
    assert [line.split()[:2] for line in lines] == [
        ["map"],
        ["`-", "base"],
        ["|-", "camera"],
        ["`-", "gr\\xf6\\xdfe"],
    ]
    names = {record["name"] for record in document(run("frames", "--json"))["frames"]}
    assert "größe" in names
    assert "gr" in refusal(run("lookup", "map", "große"))


def test_no_server(zenoh_tf: Run) -> None:
    line = refusal(zenoh_tf("--connect", "tcp/127.0.0.1:9", "--timeout", "0.5s", "frames"))
    assert "ServerUnavailable" in line
    assert "tcp/127.0.0.1:9" in line


def test_no_such_tree(run: Run) -> None:
    line = refusal(run("--tree", "elsewhere", "--timeout", "0.5s", "frames"))
    assert "ServerUnavailable" in line
    assert "elsewhere" in line


@pytest.mark.parametrize(
    "args",
    [
        [],
        ["fly"],
        ["lookup", "map"],
        ["lookup", "map", "base", "--at", "noon"],
        ["lookup", "map", "base", "--at", "now5"],
        ["lookup", "map", "base", "--at", "5"],
        ["wait", "map", "base", "--for", "5"],
        ["set", "map", "base", "1", "2"],
        ["set", "map", "base", "1", "2", "x"],
        ["--timeout", "-1s", "frames"],
        ["frames", "--dot", "--mermaid"],
        ["frames", "--dot", "--json"],
        ["--json", "frames", "--mermaid"],
        ["frame"],
        ["replay", "file", "--rate", "-1"],
    ],
)
def test_wrong_usage(zenoh_tf: Run, args: list[str]) -> None:
    done = zenoh_tf(*args)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    if "--json" in args:
        assert json.loads(done.stderr)["type"] == "UsageError"
    else:
        assert "usage: zenoh-tf" in done.stderr


def test_interrupted() -> None:
    """Ctrl-C while it waits for a server that does not answer."""
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        with forks.Popen(
            [sys.executable, "-m", "zenoh_tf_tools", "--connect", endpoint, "frames"],
            stderr=subprocess.PIPE,
        ) as process:
            mute.settimeout(20)
            mute.accept()[0].close()
            process.send_signal(signal.SIGINT)
            assert process.stderr is not None
            assert process.stderr.read() == "interrupted\n"
            assert process.wait(10) == -signal.SIGINT
