"""``zenoh-tf explain``, and names that do not exist."""

from __future__ import annotations

import json

import pytest

from .conftest import Run, document, refusal, succeeds


@pytest.mark.usefixtures("chain")
def test_explain_a_lookup_that_succeeds(run_here: Run) -> None:
    text = succeeds(run_here("explain", "map", "camera"))
    assert text.splitlines()[0] == "camera in map at the latest common time"
    assert "map -> base" in text and "wheels" in text
    assert "The lookup succeeds at 2.000000000 s." in text
    found = document(run_here("explain", "map", "camera", "--at", "1.5s", "--json"))
    assert (found["possible"], found["at_ns"], found["limiting_frame"]) == (
        True,
        1_500_000_000,
        "base",
    )
    assert [link["child"] for link in found["links"]] == ["base", "camera"]


@pytest.mark.usefixtures("chain")
def test_explain_a_lookup_that_fails(run_here: Run) -> None:
    done = run_here("explain", "map", "camera", "--at", "2.5s")
    assert (done.returncode, done.stderr) == (3, "")
    assert "2.500000000 s is 500 ms after the newest sample of 'map' -> 'base'." in done.stdout
    done = run_here("explain", "map", "camera", "--at", "2.5s", "--json")
    assert done.returncode == 3
    found = json.loads(done.stdout)
    assert (found["error"], found["limiting_frame"]) == ("ForwardExtrapolationException", "base")


@pytest.mark.usefixtures("chain")
def test_names_that_do_not_exist(run_here: Run) -> None:
    done = run_here("explain", "map", "Camera")
    assert done.returncode == 3
    assert "Did you mean 'camera'?" in done.stdout
    for command in (("lookup", "map", "camra"), ("latest", "camra", "map"), ("frame", "camra")):
        assert refusal(run_here(*command)).endswith("; did you mean 'camera'?")
    both = refusal(run_here("lookup", "camra", "bas"))
    assert both.endswith("; did you mean 'camera' instead of 'camra', and 'base' instead of 'bas'?")
    assert "did you mean" not in refusal(run_here("lookup", "map", "zzz"))
    done = run_here("lookup", "map", "camra", "--json")
    assert json.loads(done.stderr)["message"].endswith("; did you mean 'camera'?")


def test_explain_without_a_server(command: Run) -> None:
    done = command("explain", "a", "b", "--connect", "tcp/127.0.0.1:9", "--timeout", "0.2s")
    assert "ServerUnavailable" in refusal(done)
