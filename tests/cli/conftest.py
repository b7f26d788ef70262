"""Commands as processes, without and with a terminal."""

from __future__ import annotations

import functools
import json
import os
import pty
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.processes import forks
from tests.processes.servers import Pool, ServerProcess
from tests.support import command_line
from tests.support.command_line import MODULE, Done, Run
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session import environment

HALF_TURN = (0, 0, 1, 0)


@pytest.fixture
def zenoh_tf() -> Run:
    """``zenoh_tf(*args)``: one command as a process, to its end."""
    return command_line.run


@pytest.fixture
def in_terminal() -> Callable[..., str]:
    """``in_terminal(*args, **environment)``: what a command writes to a terminal."""

    def run(*args: str, **environment: str) -> str:
        ours, theirs = pty.openpty()
        inherited = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
        with forks.Popen(
            [sys.executable, *MODULE, *args],
            stdout=theirs,
            stderr=theirs,
            env={**inherited, "TERM": "xterm", **environment},
        ) as process:
            os.close(theirs)
            output = b""
            try:
                while piece := os.read(ours, 4096):
                    output += piece
            except OSError:  # how Linux says that the other end is closed
                pass
            os.close(ours)
            assert process.wait(30) == 0, output
        return output.decode()

    return run


@pytest.fixture
def run(server: ServerProcess, zenoh_tf: Run) -> Run:
    """``run(*args)``: one command on the server, to its end."""
    return functools.partial(zenoh_tf, "--connect", server.endpoint)


def succeeds(done: Done) -> str:
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def document(done: Done) -> Any:
    return json.loads(succeeds(done))


def refusal(done: Done) -> str:
    """The one line that a failed command prints."""
    assert done.returncode == 1
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("zenoh-tf: ")
    return lines[0]


@pytest.fixture
def chain(client: TransformClient) -> None:
    """map -> base at 1 s and 2 s, turning left; base -> camera static."""
    start = StampedTransform("map", "base", 1_000_000_000, Transform())
    end = StampedTransform("map", "base", 2_000_000_000, Transform((2, 0, 0), HALF_TURN))
    client.set_transforms_xact([start, end], authority="wheels")
    mount = StampedTransform("base", "camera", 0, Transform((1, 0, 0)))
    client.set_transform(mount, authority="wheels", static=True)


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Run:
    """``command(*args)``: one command in this process, which is much quicker."""

    return functools.partial(command_line.call, capsys)


@pytest.fixture
def run_here(server: ServerProcess, command: Run) -> Run:
    """As ``run``, but in this process."""
    return functools.partial(command, "--connect", server.endpoint)


@pytest.fixture(scope="module")
def shared_server(server_pool: Pool) -> ServerProcess:
    """A server for a whole file, with a long cache. Each test has a tree of its own choice in it:
    see `robot`."""
    return server_pool.lend("--cache-time", "1000s", of_file=True)


@pytest.fixture
def robot(
    shared_server: ServerProcess, monkeypatch: pytest.MonkeyPatch
) -> Iterator[TransformClient]:
    """A client of a server that has map -> odom -> base_link -> camera (static) and gripper, with
    samples from 10 s ago to 5 minutes ahead. It is the default of all commands."""
    monkeypatch.setenv(environment.ENDPOINT_VARIABLE, shared_server.endpoint)
    with shared_server.connect() as tf:
        now_ns = time.time_ns()
        for parent, child, authority in (
            ("map", "odom", "amcl"),
            ("odom", "base_link", "wheels"),
            ("base_link", "gripper", "arm"),
        ):
            poses = [(now_ns + n * 10**9, Transform((n / 10, 0, 0))) for n in range(-10, 300)]
            rows = [StampedTransform(parent, child, stamp_ns, pose) for stamp_ns, pose in poses]
            tf.set_transforms_xact(rows, authority=authority)
        mount = StampedTransform("base_link", "camera", 0, Transform((0.1, 0, 0.2)))
        tf.set_transform(mount, authority="mounts", static=True)
        yield tf
        tf.reset()
