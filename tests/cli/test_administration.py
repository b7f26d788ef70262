"""Commands about a server as a whole: which one, what it has refused, and its reset."""

from __future__ import annotations

import functools
import json
import subprocess
import time
from collections.abc import Callable
from typing import Any

import pytest

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def run(server: Any, zenoh_tf: Run) -> Run:
    """``run(*args)``: one command on the server, to its end."""
    return functools.partial(zenoh_tf, "--connect", server.endpoint)


def succeeds(done: subprocess.CompletedProcess[str]) -> str:
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def document(done: subprocess.CompletedProcess[str]) -> Any:
    return json.loads(succeeds(done))


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    assert (done.returncode, done.stdout) == (1, "")
    return done.stderr


@pytest.mark.own_server
def test_authorities_shows_refusals(run: Run, client: TransformClient) -> None:
    """Also those of an authority that never had a transform accepted."""
    with client.broadcaster("broken driver") as broken:
        broken.send([StampedTransform("a", "a", stamp, Transform()) for stamp in range(3)])
        deadline = time.monotonic() + 10
        while not client.authorities():
            assert time.monotonic() < deadline
            time.sleep(0.01)
    (record,) = document(run("authorities", "--json"))["authorities"]
    assert (record["name"], record["refused"], record["stored"]) == ("broken driver", 3, 0)
    _, line, reason = succeeds(run("authorities")).splitlines()
    assert line.split() == ["broken", "driver", *"0000003", "0", "-", "-"]
    assert reason.startswith("last refusal of broken driver: InvalidArgumentException: ")
    assert "own parent" in reason


def test_reset_forgets_names_and_needs_a_yes(run: Run, client: TransformClient) -> None:
    client.set_transform(StampedTransform("map", "base", 1, Transform()))
    client.set_transform(StampedTransform("base", "camera", 0, Transform()), static=True)
    done = run("reset")
    assert done.returncode == 2
    assert "--yes" in done.stderr
    assert len(client.frames()) == 3
    assert "reset" in succeeds(run("reset", "--yes"))
    assert client.frames() == []
    assert succeeds(run("frames")) == "no frames\n"
    assert document(run("reset", "--yes", "--json")) == {"reset": True}


def test_the_environment_names_server_and_tree(
    start_server: Any, zenoh_tf: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = start_server(tree="robot 1")
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    monkeypatch.setenv("ZENOH_TF_TREE", "robot 1")
    succeeds(zenoh_tf("set", "map", "base", "0", "0", "0"))
    assert document(zenoh_tf("frames", "--json"))["tree"] == "robot 1"
    line = refusal(zenoh_tf("--connect", "tcp/127.0.0.1:9", "--timeout", "0.5s", "frames"))
    assert "tcp/127.0.0.1:9" in line
    line = refusal(zenoh_tf("frames", "--tree", "elsewhere"))
    assert "trees served there: 'robot 1'" in line
    monkeypatch.setenv("ZENOH_TF_CONNECT", "tcp/127.0.0.1:9")
    assert "tcp/127.0.0.1:9" in refusal(zenoh_tf("--timeout", "0.5s", "frames"))
