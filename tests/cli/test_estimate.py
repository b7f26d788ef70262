"""``zenoh-tf estimate``, ``echo --estimate``, and what ``explain`` says about now."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import pytest

from tests.recordings.files import Log, write
from tests.support.command_line import Run
from tests.support.moving_arm import MS, fill
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.estimate_words import metres

from .conftest import document, refusal, succeeds

END_NS = 10**18
AT = ("--at", f"{END_NS + 30 * MS}ns")


@pytest.fixture
def run(run_here: Run) -> Run:
    return run_here


def test_a_pose_and_its_error(run: Run, client: TransformClient) -> None:
    fill(client, END_NS)
    found = client.estimate_transform("map", "tool", END_NS + 30 * MS)
    shown = document(run("estimate", "map", "tool", *AT, "--json"))
    assert shown["translation"] == pytest.approx(found.transform.translation.tolist())
    assert shown["error_m"] == pytest.approx(found.error_m)
    assert shown["error_rad"] == pytest.approx(found.error_rad)
    assert (shown["level"], shown["backtests"]) == (found.level, found.backtests)
    assert (shown["basis"], shown["by_ns"]) == ("backtest", 30 * MS)
    assert shown["predictor"] == dict(found.predictor)

    lines = succeeds(run("estimate", "map", "tool", *AT)).splitlines()
    assert lines[0] == "tool in map"
    rows = {line.split()[0]: line.split(maxsplit=1)[1] for line in lines[1:] if line.strip()}
    assert rows["error"].startswith(f"within {metres(found.error_m)} and ")
    assert f"of {found.backtests} backtests)" in rows["error"]
    assert "30 ms: base by " in rows["carried"]
    static = succeeds(run("estimate", "arm", "tool"))
    assert "error        none: all links are static" in static


def base_at(after_s: float) -> float:
    """A base that swings from 15 s on."""
    return math.sin(2 * max(0.0, after_s - 15.0))


@pytest.fixture
def recording(tmp_path: Path) -> str:
    """Its samples at 20 Hz are recorded 50 ms late."""
    rows = [("map", "base", 100.0 + i / 20, base_at(i / 20)) for i in range(600)]
    log: Log = [
        (99.0, "/tf_static", [("base", "tip", 0.0, 1.0)]),
        *((row[2] + 0.05, "/tf", [row]) for row in rows),
    ]
    return str(write(tmp_path / "log", log))


def test_a_recording_is_asked_for_what_was_known(command: Run, recording: str) -> None:
    def shown(*arguments: str) -> Any:
        return document(command("estimate", recording, "map", "tip", *arguments, "--json"))

    # At 10.1 s the newest sample is that of 10.05 s.
    rest = shown("--at", "+10.1s")
    assert (rest["by_ns"], rest["translation"]) == (50 * MS, [1.0, 0.0, 0.0])
    assert rest["error_m"] < 1e-6  # nobody could know yet that it starts
    begin = shown("--at", "+15.3s", "--known", "+15s")
    assert (begin["by_ns"], begin["translation"]) == (350 * MS, [1.0, 0.0, 0.0])
    moving = shown("--at", "+25.1s")
    assert moving["by_ns"] == 50 * MS and moving["error_m"] > 1e-6
    assert abs(moving["translation"][0] - 1 - base_at(25.1)) <= moving["error_m"]
    assert "publishes at 20 Hz, and its newest sample is 50 ms older" in moving["advice"]
    later = shown("--at", "+25.1s", "--known", "+26s")
    assert (later["by_ns"], later["translation"][0]) == (0, pytest.approx(1 + base_at(25.1)))
    end = shown()
    assert (end["stamp_ns"], end["by_ns"]) == (129_950 * MS, 50 * MS)
    ask = ("estimate", recording, "map", "tip", "--at", "+25.1s")
    ended = command(*ask, "--max-error", "0.001mm")
    assert (ended.returncode, ended.stdout) == (3, "")
    assert "did you mean 'tip'" in refusal(command("estimate", recording, "map", "tipp"))


def test_times_of_a_recording_that_are_refused(
    command: Run, recording: str, tmp_path: Path
) -> None:
    ask = ("estimate", recording, "map", "base", "--at", "+1s")
    assert "--known 3s is the stamp" in refusal(command(*ask, "--known", "3s"))
    nothing = refusal(command(*ask, "--known", "-40s"))
    assert "nothing was recorded by 89.950" in nothing and "the log begins at 99.0" in nothing
    # A simulation: the log has the real time.
    log: Log = [(1e9 + i, "/tf", [("map", "base", float(i), 0.0)]) for i in range(99)]
    simulated = str(write(tmp_path / "sim", log))
    assert "the log begins at" in refusal(command("estimate", simulated, "map", "base"))
    late: Log = [(float(i), "/tf", [("map", "base", 1000.0 + i, 0.0)]) for i in range(9)]
    ahead = str(write(tmp_path / "ahead", late))
    text = refusal(command("estimate", ahead, "map", "base"))
    assert "what was known by then is unclear" in text and "simulated time" in text


def test_what_would_make_it_better(run: Run, client: TransformClient) -> None:
    fill(client, END_NS)
    shown = document(run("estimate", "map", "tool", *AT, "--json"))
    parent, child = shown["limiting_link"]
    assert shown["advice"].startswith(f"{parent} -> {child} makes ")
    assert f"of the {metres(shown['error_m'])}: driver publishes at " in shown["advice"]
    assert shown["advice"] in succeeds(run("estimate", "map", "tool", *AT))


def test_exit_code_3_if_it_is_too_uncertain(run: Run, client: TransformClient) -> None:
    fill(client, END_NS)
    succeeds(run("estimate", "map", "tool", *AT, "--max-error", "1m", "--max-angle", "1rad"))
    for limit in (("--max-error", "0.001mm"), ("--max-angle", "0.0001deg")):
        ended = run("estimate", "map", "tool", *AT, *limit)
        assert (ended.returncode, ended.stdout) == (3, "")
        assert ended.stderr.startswith("zenoh-tf: TooUncertain: ")
        assert len(ended.stderr.splitlines()) == 1
    error = json.loads(run("estimate", "map", "tool", *AT, *limit, "--json").stderr)
    assert error["type"] == "TooUncertain" and error["fields"]["by_ns"] == 30 * MS
    assert "LookupException" in refusal(run("estimate", "map", "nobody", *AT))
    later = ("estimate", "map", "tool", "--at", f"{END_NS + 501 * MS}ns")
    assert "at most 0.5 s (max_by_s)" in refusal(run(*later))
    succeeds(run(*later, "--max-by", "1s"))


def test_echo_and_explain_are_about_now(run: Run, client: TransformClient) -> None:
    fill(client, time.time_ns())
    now = ("--estimate", "--max-by", "200s", "--rate", "50", "--count", "2")
    shown = succeeds(run("echo", "map", "tool", *now, "--json")).splitlines()
    first, second = (json.loads(line) for line in shown)
    assert first["stamp_ns"] < second["stamp_ns"]
    assert 0 < first["by_ns"] < second["by_ns"]
    assert "  error  " in succeeds(run("echo", "map", "tool", *now))


def test_explain_says_how_well_it_is_known_now(run: Run, client: TransformClient) -> None:
    fill(client, time.time_ns() + 10**9)  # so that now is not beyond what may be estimated
    text = succeeds(run("explain", "map", "tool"))
    assert "\n\nEstimated for now, it is within " in text
    assert document(run("explain", "map", "tool", "--json"))["now"]["error_m"] >= 0
    assert "Estimated" not in succeeds(run("explain", "arm", "tool"))


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.11, "11 cm"), (0.0004, "0.4 mm"), (0.0204, "2 cm"), (1.26, "1.3 m"), (0.996, "100 cm")],
)
def test_metres(value: float, text: str) -> None:
    assert metres(value) == text
