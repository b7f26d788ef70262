"""How commands fail, and stamps and encodings that they used to fail on."""

from __future__ import annotations

import json
import re
import shlex
import signal
import socket
import subprocess
import time
from typing import Any

import pytest

from tests.support.command_line import Run, begun
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


@pytest.mark.parametrize("line", ["frames", "explain a b", "wait a b --for 0.3s"])
def test_no_server(command: Run, line: str) -> None:
    connect = ("--connect", "tcp/127.0.0.1:9", "--timeout", "0.3s")
    error = refusal(command(*connect, *line.split()))
    assert "ServerUnavailable" in error
    assert "tcp/127.0.0.1:9" in error


def test_no_such_tree(run: Run) -> None:
    line = refusal(run("--tree", "elsewhere", "--timeout", "0.5s", "frames"))
    assert "ServerUnavailable" in line
    assert "elsewhere" in line


AMBIGUOUS = "is ambiguous: {0} seconds or {0} milliseconds"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("--tree main", "the following arguments are required: COMMAND"),
        ("fly", "there is no command 'fly'; zenoh-tf --help lists all"),
        ("lokup map base", "there is no command 'lokup'; did you mean 'lookup'?"),
        ("calibration sav x", "there is no action 'sav'; did you mean 'save'?"),
        ("lookup map base --att now", "unrecognized arguments: --att now; did you mean '--at'?"),
        (
            "query file a b --evry 1s",
            "did you mean '--every'?\nusage: zenoh-tf query [options] FILE",
        ),
        ("query file a b --count 1", "'1' is not a whole number from 2"),
        ("query file a b --count 2 --every 1s", "not allowed with"),
        ("lookup map", "the following arguments are required: SOURCE"),
        ("lookup map base --at noon", "'noon' is not a time"),
        ("lookup map base --at now5", "'now5' is not a time"),
        ("lookup map base --at 5", "'5' is ambiguous: the stamp 5 s or the stamp 5 ns"),
        ("wait map base --for 5", AMBIGUOUS.format(5)),
        ("wait map base --for -1s", "'-1s' is not a duration of at least 0 s"),
        ("wait map base --for nan", "'nan' is not a duration"),
        ("set map base 1 2", "a pose is 3 or 7 numbers, not 2"),
        ("set map base 1 2 x", "'x' is not a number"),
        ("set map base 1 2 3 --yaw 90", "'90' is ambiguous: 90 degrees or 90 radians; write 90deg"),
        ("set map base 1 2 3 --yaw -1.5", "'-1.5' is ambiguous: -1.5 degrees or -1.5 radians"),
        ("set map base 1 2 3 --roll 1m", "'1m' is not an angle; give 90deg or 1.57rad"),
        ("set map base 1 2 3 0 0 0 1 --pitch 0", "give angles or a quaternion, not both"),
        ("velocity base map --at 5", "'5' is ambiguous: the stamp 5 s or the stamp 5 ns"),
        ("velocity base map --at noon", "argument --at: 'noon' is not a time; give 2026"),
        ("velocity base map file --at now", "argument --at: 'now' is not a time; give +10s"),
        ("velocity base map file surplus", "unrecognized arguments: surplus"),
        ("--timeout -1s frames", "'-1s' is not a duration above 0 s"),
        ("frames --dot --mermaid", "not allowed with"),
        ("frames --dot --json", "--json cannot be combined with --dot or --mermaid"),
        ("--json frames --mermaid", "--json cannot be combined with --dot or --mermaid"),
        ("frame", "the following arguments are required: FRAME"),
        ("echo a", "the following arguments are required: SOURCE"),
        ("echo a b --rate 0", "'0' is not a number above 0"),
        ("echo a b --count 0", "'0' is not a whole number from 1"),
        ("echo a b --count some", "'some' is not a whole number"),
        ("monitor --every 0", "'0' is not a duration above 0 s"),
        ("monitor --pair map", "argument --pair: expected 2 arguments"),
        ("top --pair map base cup", "unrecognized arguments: cup"),
        ("doctor --for -1s", "'-1s' is not a duration of at least 0 s"),
        ("doctor --for soon", "'soon' is not a duration"),
        ("doctor --ignore TF999", "invalid choice: 'TF999'"),
        ("doctor a.mcap surplus", "unrecognized arguments: surplus"),
        ("replay file --loop --rate 0", "need a --rate above 0"),
        ("replay file --clock now --rate 0", "need a --rate above 0"),
        (
            "replay file --start 3",
            "'3' is ambiguous: 3 s after the recording's first stamp, or the",
        ),
        ("replay file --rate -1", "'-1' is not a number of at least 0"),
        ("replay file --clock later", "invalid choice"),
        # The server does not count for it, so replay could not know what became of its transforms.
        ("replay file --authority ''", "the name is empty"),
        ("plot map wheel --start +1s", "--start and --end choose times of a recording: give its"),
        ("estimate map base --known -1s", "--known belongs to FILE"),
        ("urdf arm.urdf --print --joint-states", "--print asks no server"),
        ("record", "the following arguments are required: OUT"),
        ("completion fish", "invalid choice: 'fish'"),
        ("query file odom", "give both TARGET and SOURCE, or neither"),
        ("query file odom base --start 1s", "--start and --end belong to --every and --count"),
        ("query file odom base --every 20", AMBIGUOUS.format(20)),
        ("query file odom base --every 0", "'0' is not a duration of at least"),
        ("query file odom base --at now", "is not a time"),
        ("query file odom base --at 10", "--at: '10' is ambiguous: 10 s after the recording's"),
        ("query file odom base --at 9223372036854775808ns", "too large for 64 bits"),
        ("query file odom base --every 99999999999s", "is not a duration of at least"),
        ("query file odom base --at 1s --every 1s", "not allowed with"),
    ],
)
def test_wrong_usage(command: Run, line: str, message: str) -> None:
    done = command(*shlex.split(line))
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    if "--json" in line:
        assert json.loads(done.stderr)["type"] == "UsageError"
    else:
        first, usage, *_ = done.stderr.splitlines()
        assert first.startswith("zenoh-tf") and ": error: " in first
        assert usage.startswith("usage: zenoh-tf")


def test_no_arguments_print_the_help(command: Run) -> None:
    done, asked = command(), command("--help")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == asked.stdout


def test_interrupted() -> None:
    """Ctrl-C while it waits for a server that does not answer."""
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        with begun("--connect", endpoint, "frames") as process:
            mute.settimeout(20)
            mute.accept()[0].close()
            process.send_signal(signal.SIGINT)
            assert process.stderr is not None
            assert process.stderr.read() == "interrupted\n"
            assert process.wait(10) == -signal.SIGINT
