"""``zenoh-tf doctor`` and ``explain``, and names that do not exist."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command_line import Run
from tests.support.recorded import RUN, needs_recording
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

from .conftest import document, refusal, succeeds


@pytest.mark.usefixtures("chain")
@pytest.mark.own_server
def test_a_healthy_tree(run_here: Run) -> None:
    """Its stamps are of another clock, so nothing gets old while the command starts."""
    assert succeeds(run_here("doctor", "--for", "0")) == "no faults in 3 frames\n"
    # Two looks see no gap either, as the link has no rate to speak of.
    found = document(run_here("doctor", "--for", "0.2s", "--json"))
    assert (found["findings"], found["frames"]) == ([], 3)
    assert found["observed_s"] >= 0.2


@pytest.mark.usefixtures("chain")
@pytest.mark.own_server
def test_faults_are_reported(run_here: Run, client: TransformClient) -> None:
    for n, authority in enumerate(["old", "wheels"]):
        row = StampedTransform("map", "base", 2_000_000_001 + n, Transform())
        client.set_transform(row, authority=authority)
    client.set_transform(StampedTransform("world", "Camera", 0, Transform()), static=True)
    done = run_here("doctor", "--for", "0")
    assert (done.returncode, done.stderr) == (3, "")
    lines = done.stdout.splitlines()
    assert lines[0] == "3 faults in 5 frames"
    assert [line[:5] for line in lines if line.startswith("TF")] == ["TF101", "TF301", "TF302"]
    assert "  - base: the link has changed hands twice, the last time to 'wheels'; " in done.stdout
    done = run_here("doctor", "--for", "0", "--json", "--ignore", "TF101", "--ignore", "TF302")
    assert done.returncode == 3
    (finding,) = json.loads(done.stdout)["findings"]
    assert (finding["id"], finding["subject"]) == ("TF301", "world")
    assert all(finding[key] for key in ("title", "evidence", "explanation", "remedy"))


@pytest.mark.own_server
def test_what_a_server_refused(run_here: Run, client: TransformClient) -> None:
    with client.broadcaster("driver") as broadcaster:
        broadcaster.send([StampedTransform("a", "b", 1, Transform())])
        broadcaster.send([StampedTransform("b", "a", 1, Transform())])
        while not any(authority.refused for authority in client.authorities()):
            pass
    done = run_here("doctor", "--for", "0", "--json")
    (finding,) = json.loads(done.stdout)["findings"]
    assert (finding["id"], finding["subject"]) == ("TF106", "driver")


@needs_recording
def test_a_recording(command: Run) -> None:
    found = document(command("doctor", str(RUN), "--json"))
    assert (found["tree"], found["file"], found["findings"]) == (None, str(RUN), [])


def test_a_file_that_is_no_recording(command: Run, tmp_path: Path) -> None:
    assert "no such file" in refusal(command("doctor", str(tmp_path / "none.mcap")))


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


@needs_recording
def test_explain_a_lookup_in_a_recording(command: Run) -> None:
    """Its times count from its first and last stamp, and it has no present."""
    text = succeeds(command("explain", str(RUN), "map", "base_link", "--at", "+42.4s"))
    assert text.splitlines()[0] == "base_link in map at 971.200000000 s"
    assert "The lookup succeeds at 971.200000000 s.\n" in text
    found = document(command("explain", str(RUN), "map", "base_link", "--json"))
    assert (found["limiting_frame"], found["by_clock"]) == ("base_link", False)
    done = command("explain", "--at", "-200s", str(RUN), "map", "base_link")
    assert done.returncode == 3
    assert "before the oldest sample of 'map' -> 'odom'" in done.stdout
    assert done.stdout.splitlines()[-1] == (
        "- The recording has data of all links of the chain from 929.800000000 s to "
        "1025.496000000 s."
    )
    done = command("explain", str(RUN), "map", "base_lnk")
    assert done.returncode == 3
    assert "Did you mean 'base_link'" in done.stdout


@needs_recording
def test_a_recording_has_names_that_may_be_meant(command: Run) -> None:
    done = command("query", str(RUN), "map", "base_lnk")
    assert "; did you mean 'base_link'" in refusal(done)


@pytest.mark.usefixtures("chain")
def test_a_time_of_no_form(run_here: Run) -> None:
    for file in ((), ("run.mcap",)):
        done = run_here("explain", *file, "map", "camera", "--at", "10")
        assert done.returncode == 2
        assert "argument --at: '10' is ambiguous" in done.stderr


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
