"""The command line against a real server."""

from __future__ import annotations

import argparse
import math
import re
import time
from collections.abc import Callable
from typing import Any

import pytest

from tests.support.command_line import Run, begun
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.introspection.metric_table import FROM_ROBOTS, FROM_STATS
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session.mapped_tree import COUNTERS
from zenoh_tf_tools.cli.main import _parser
from zenoh_tf_tools.cli.tree.inspect import _meaning

from .conftest import document, refusal, succeeds


@pytest.fixture
def run(run_here: Run) -> Run:
    """In this process; the tests at the end need processes."""
    return run_here


@pytest.mark.own_server
def test_an_empty_tree(run: Run) -> None:
    assert succeeds(run("frames")) == "no frames\n"
    assert document(run("frames", "--json"))["frames"] == []
    for form in ("--dot", "--mermaid"):
        assert "no frames" in succeeds(run("frames", form))
    assert succeeds(run("authorities")) == "no authorities\n"


@pytest.mark.usefixtures("chain")
def test_lookup_interpolates_at_a_time(run: Run) -> None:
    answer = document(run("lookup", "map", "camera", "--at", "1.5s", "--json"))
    assert (answer["target"], answer["source"]) == ("map", "camera")
    assert answer["stamp_ns"] == 1_500_000_000
    assert answer["translation"] == pytest.approx([1.0, 1.0, 0.0])
    assert answer["rotation"] == pytest.approx([0, 0, 0.5**0.5, 0.5**0.5])


@pytest.mark.usefixtures("chain")
def test_lookup_without_a_time_is_at_the_latest_common_time(run: Run) -> None:
    answer = document(run("--json", "lookup", "map", "camera"))
    assert answer["stamp_ns"] == 2_000_000_000
    assert answer["translation"] == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.usefixtures("chain")
@pytest.mark.parametrize("flags", [[], ["--no-xact"]])
def test_latest_gives_the_age_of_its_links(run: Run, flags: list[str]) -> None:
    succeeds(run("set", "camera", "object", "0", "0", "1", "--stamp", "5s"))
    answer = document(run("latest", "map", "object", "--json", *flags))
    assert answer["stamp_ns"] == 2_000_000_000
    assert answer["newest_stamp_ns"] == 5_000_000_000
    assert answer["translation"] == pytest.approx([1.0, 0.0, 1.0])


@pytest.mark.usefixtures("chain")
def test_answers_for_reading(run: Run) -> None:
    text = succeeds(run("lookup", "map", "camera"))
    assert text.splitlines()[0] == "camera in map"
    assert "2.000000000 s" in text
    assert "x   1.000000  y   0.000000  z   0.000000  m" in text
    assert "yaw 180.00  deg" in text
    assert "\x1b" not in text

    text = succeeds(run("latest", "map", "camera"))
    assert "newest link  2.000000000 s" in text


def test_set_takes_numbers_as_people_write_them(run: Run) -> None:
    done = document(run("set", "a", "b", "-1e-3", "-.5", "+2.", "--json"))
    assert done["stored"] is True
    assert abs(done["stamp_ns"] - time.time_ns()) < 60 * 10**9
    answer = document(run("latest", "a", "b", "--json"))
    assert answer["translation"] == [-0.001, -0.5, 2.0]


def test_set_says_when_it_was_too_old(run: Run) -> None:
    succeeds(run("set", "a", "b", "0", "0", "0", "--stamp", "1000s"))
    assert "dropped" in refusal(run("set", "a", "b", "0", "0", "0", "--stamp", "1s"))


def test_set_refuses_what_is_no_rotation(run: Run) -> None:
    line = refusal(run("set", "a", "b", "0", "0", "0", "9", "0", "0", "9"))
    assert "InvalidArgumentException" in line
    assert "quaternion" in line


@pytest.mark.usefixtures("chain")
def test_velocity(run: Run) -> None:
    """Half a turn to the left and two metres ahead in a second."""
    asked = ("velocity", "base", "map", "--at", "1.5s", "--interval", "0.5s")
    answer = document(run(*asked, "--json"))
    assert (answer["tracking"], answer["observation"]) == ("base", "map")
    assert answer["reference"] == "map"
    assert (answer["stamp_ns"], answer["end_ns"]) == (1_500_000_000, 1_750_000_000)
    assert answer["linear"] == pytest.approx([2, 0, 0])
    assert answer["angular"] == pytest.approx([0, 0, math.pi])
    # Base has turned by a quarter then: ahead of map is to its right.
    answer = document(run(*asked, "--reference", "base", "--json"))
    assert answer["linear"] == pytest.approx([0, -2, 0])

    lines = succeeds(run(*asked)).splitlines()
    assert lines[0] == "base as seen from map, in the axes of map"
    assert lines[2].split() == ["averaged", "over", "500", "ms"]
    assert lines[3].split() == ["linear", "x", "2.000000", "y", "0.000000", "z", "0.000000", "m/s"]
    assert lines[5].endswith("z 180.00  deg/s")


@pytest.mark.usefixtures("chain")
def test_static_answers_have_no_time(run: Run) -> None:
    """Their stamp is 0, which may be a sample's, too."""
    for command in (
        ("lookup", "base", "camera"),
        ("latest", "base", "camera"),
        ("wait", "base", "camera"),
        ("echo", "base", "camera", "--count", "1"),
        ("echo", "base", "camera", "--on-change", "--count", "1"),
        ("velocity", "camera", "base"),
    ):
        lines = succeeds(run(*command)).splitlines()
        assert lines[1].split() == ["time", "static"], command
    assert document(run("lookup", "base", "camera", "--json"))["stamp_ns"] == 0
    assert "0.000000000 s" not in succeeds(run("frame", "camera"))
    succeeds(run("set", "start", "now", "0", "0", "0", "--stamp", "0s"))
    assert "time         0.000000000 s" in succeeds(run("lookup", "start", "now"))


@pytest.mark.usefixtures("chain")
def test_velocity_over_no_time(run: Run) -> None:
    assert "averaging_interval_s" in refusal(run("velocity", "base", "map", "--interval", "0"))


@pytest.mark.usefixtures("chain")
@pytest.mark.own_server
def test_frames_draws_the_tree(run: Run) -> None:
    succeeds(run("set", "base", "arm", "0", "0", "0", "--stamp", "2.5s", "--authority", "motors"))
    _, *lines = succeeds(run("frames")).splitlines()
    assert [line.split() for line in lines] == [
        ["map"],
        # Recorded time: there is no clock to count a delay from.
        ["└─", "base", "2.0", "2.000", "1.000", "2", "wheels"],
        ["├─", "arm", "2.500", "0.000", "1", "motors"],
        ["└─", "camera", "static", "1", "wheels"],
    ]


def test_frames_counts_delays_by_the_clock(run: Run) -> None:
    succeeds(run("set", "map", "base", "0", "0", "0", "--stamp", "now-100s"))
    header, _, base = succeeds(run("frames")).splitlines()
    assert "delay [s]" in header
    assert 100 <= float(base.split()[2]) < 160


@pytest.mark.usefixtures("chain")
@pytest.mark.own_server  # counters of other tests' frames would be in it
def test_frames_as_a_graph(run: Run) -> None:
    graph = succeeds(run("frames", "--dot"))
    assert graph.startswith("digraph ")
    assert graph.count(" -> ") == 2
    assert 'label="wheels\\nrate 2.0 Hz\\n' in graph
    chart = succeeds(run("frames", "--mermaid"))
    assert chart.startswith("flowchart ")
    assert '-->|"wheels<br/>rate 2.0 Hz<br/>' in chart
    assert '-.->|"wheels<br/>static"|' in chart


@pytest.mark.usefixtures("chain")
def test_frames_json(run: Run) -> None:
    tree = document(run("frames", "--json"))
    assert tree["tree"] == "main"
    records = {record["name"]: record for record in tree["frames"]}
    assert set(records) == {"map", "base", "camera"}
    assert records["map"]["parent"] is None
    assert records["camera"]["parent"] == "base"
    assert records["camera"]["static"] is True
    assert records["base"]["newest_stamp_ns"] == 2_000_000_000


@pytest.mark.usefixtures("chain")
@pytest.mark.own_server
def test_frame(run: Run) -> None:
    succeeds(run("set", "map", "base", "0", "0", "0", "--stamp", "2s", "--authority", "hand"))
    record = document(run("frame", "base", "--json"))
    assert (record["name"], record["parent"], record["authority"]) == ("base", "map", "hand")
    assert (record["rewritten"], record["authority_changes"]) == (1, 1)
    assert record["rate_hz"] == 2.0

    name, *lines = succeeds(run("frame", "base")).splitlines()
    assert name == "base"
    facts = {label: rest for label, *rest in map(str.split, lines)}
    assert facts["parent"] == ["map"]
    assert facts["authority"] == ["hand"]
    assert facts["rate"] == ["2.0", "Hz"]
    assert facts["newest"] == ["2.000000000", "s"]
    assert facts["oldest"] == ["1.000000000", "s"]
    assert facts["samples"] == ["2"]
    assert (facts["rewritten"], facts["conflicts"]) == (["1"], ["1"])
    assert "last change  taken over by hand" in lines[-4]
    assert "stamp      2.000000000 s" in lines[-3]
    assert lines[-2].split() == ["before", "parent", "map", "by", "wheels"]


@pytest.mark.usefixtures("chain")
def test_frame_that_is_static_and_frame_without_a_link(run: Run) -> None:
    assert "static       holds at all times" in succeeds(run("frame", "camera"))
    assert "parent       none" in succeeds(run("frame", "map"))


@pytest.mark.usefixtures("chain")
def test_frames_in_colour_on_a_terminal(server: Any, in_terminal: Callable[..., str]) -> None:
    command = ("--connect", server.endpoint, "frames")
    assert "\x1b[" in in_terminal(*command)
    assert "\x1b[" not in in_terminal(*command, NO_COLOR="1")


@pytest.mark.usefixtures("chain")
def test_stats_count(run: Run) -> None:
    counters = document(run("stats", "--json"))
    assert counters["frames"] == 3
    lines = succeeds(run("stats")).splitlines()
    # Each counter, its value, and what it counts.
    assert [line.split()[0] for line in lines] == sorted(counters)
    for line in lines:
        assert re.fullmatch(r"[\w/]+ +[\d,]+  \w.*\w.*", line)  # refused/cycle is one


def test_every_counter_has_a_meaning() -> None:
    robots = [f"{name}/arm" for name in FROM_ROBOTS]
    for name in (*FROM_STATS, *robots, *COUNTERS):
        assert len(_meaning(name).split()) >= 2, name
        assert "these" not in _meaning(name), name  # each stands alone
    assert _meaning("of_a_newer_server") == ""


@pytest.mark.usefixtures("chain")
@pytest.mark.own_server
def test_authorities(run: Run) -> None:
    succeeds(run("set", "map", "base", "0", "0", "0", "--stamp", "2s", "--authority", "a hand"))
    found = document(run("authorities", "--json"))["authorities"]
    by_name = {record.pop("name"): record for record in found}
    assert by_name["a hand"] == {
        "frames": 1,
        "commits": 1,
        "stored": 1,
        "dropped": 0,
        "rewritten": 1,
        "conflicts": 1,
        "refused": 0,
        "last_refusal": None,
        "dropped_by_queue": 0,
        "clock_offset_min_s": None,
        "clock_offset_max_s": None,
        "stamp_age_s": None,
        "mirror_lost_s": None,
        "refused_by_reason": {},
    }
    assert (by_name["wheels"]["frames"], by_name["wheels"]["commits"]) == (1, 2)
    header, *lines = succeeds(run("authorities")).splitlines()
    counts = ["frames", "commits", "stored", "dropped", "rewritten", "conflicts", "refused"]
    counts += ["dropped_by_queue", "lead_min_s", "lead_max_s"]
    assert header.split() == counts
    assert ["a", "hand", *"1110110", "0", "-", "-"] in [line.split() for line in lines]


def test_clients(run: Run, client: TransformClient) -> None:
    name = str(client._connection.session.zid())
    deadline_s = time.monotonic() + 20
    while True:  # until the server knows its clock
        found = {each["client"]: each for each in document(run("clients", "--json"))["clients"]}
        if name in found:
            break
        assert time.monotonic() < deadline_s
        client.stats()
    assert found[name]["clock_offset_min_s"] <= 0 <= found[name]["clock_offset_max_s"]
    header, *lines = succeeds(run("clients")).splitlines()
    assert header.split() == ["client", "address", "ahead_min_s", "ahead_max_s"]
    assert (name, "tcp/127.0.0.1") in [
        (line.split()[0], line.split()[1].rpartition(":")[0]) for line in lines
    ]


@pytest.mark.usefixtures("chain")
def test_remove(run: Run) -> None:
    assert "camera" in refusal(run("remove", "base"))  # its parent would be gone
    assert succeeds(run("remove", "camera")) == "camera removed\n"
    assert "camera" in refusal(run("frame", "camera"))
    assert "LookupException" in refusal(run("remove", "camera"))


@pytest.mark.usefixtures("chain")
def test_remove_a_subtree(run: Run) -> None:
    done = document(run("remove", "base", "--subtree", "--json"))
    assert done == {"removed": "base", "subtree": True}
    assert [frame["name"] for frame in document(run("frames", "--json"))["frames"]] == ["map"]


@pytest.mark.usefixtures("chain")
def test_clear_keeps_static_links(run: Run) -> None:
    assert "cleared" in succeeds(run("clear"))
    refusal(run("lookup", "map", "base"))
    document(run("lookup", "base", "camera", "--json"))
    assert document(run("clear", "--all", "--json")) == {"cleared": True, "kept_static": False}
    refusal(run("lookup", "base", "camera"))


@pytest.mark.usefixtures("chain")
def test_a_time_that_no_link_has(run: Run) -> None:
    line = refusal(run("lookup", "map", "base", "--at", "99s"))
    assert "ForwardExtrapolationException" in line
    assert line.endswith("(97.0 s too late)")
    line = refusal(run("lookup", "map", "base", "--at", "0.25s"))
    assert "BackwardExtrapolationException" in line
    assert line.endswith("(750 ms too early)")


@pytest.mark.own_server
def test_authorities_shows_refusals(run: Run, client: TransformClient) -> None:
    """Also those of an authority that never had a transform accepted."""
    with client.broadcaster("broken driver") as broken:
        broken.send([StampedTransform("a", "a", stamp, Transform()) for stamp in range(3)])
        wait_until(client.authorities)
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


def test_version(zenoh_tf: Run) -> None:
    assert re.fullmatch(r"zenoh-tf \d+\.\d+\.\d+\S*\n", succeeds(zenoh_tf("--version")))


def test_help_names_every_command(zenoh_tf: Run) -> None:
    text = succeeds(zenoh_tf("--help"))
    named = set(re.findall(r"^    ([a-z]+)", text, re.MULTILINE))
    (actions,) = (a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction))
    assert named == set(actions.choices)
    assert {"lookup", "explain", "frames", "set", "replay", "doctor"} <= named
    without_a_server = {"completion"}
    of_actions = {"calibration"}
    for command in named - without_a_server - of_actions:
        assert "--connect" in actions.choices[command].format_help()


@pytest.mark.usefixtures("chain")
def test_a_reader_that_goes_away_is_no_error(server: Any) -> None:
    with begun("--connect", server.endpoint, "frames") as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
