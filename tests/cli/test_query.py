"""``zenoh-tf query``: recordings are asked without a server."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.recordings.files import Log, write
from tests.support.command_line import Run
from tests.support.recorded import RUN, needs_recording

from .conftest import document, refusal, succeeds


@pytest.fixture
def zenoh_tf(command: Run) -> Run:
    """In this process: there are many commands, and no server."""
    return command


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """base moves by 50 m/s from 7 s to 8 s; the camera is 1 m ahead of it."""
    return write(tmp_path_factory.mktemp("log") / "log")


@pytest.mark.parametrize(
    ("at", "stamp_ns"),
    [
        ("7.51s", 7_510_000_000),
        ("7510000000ns", 7_510_000_000),
        ("1970-01-01T00:00:07.51Z", 7_510_000_000),
        ("+0.51s", 7_510_000_000),
        ("+510ms", 7_510_000_000),
        ("-0.49s", 7_510_000_000),
    ],
)
def test_times_as_people_write_them(zenoh_tf: Run, recording: Path, at: str, stamp_ns: int) -> None:
    answer = document(zenoh_tf("query", str(recording), "odom", "camera", "--at", at, "--json"))
    assert answer["stamp_ns"] == stamp_ns
    assert answer["translation"] == pytest.approx([26.5, 0.0, 0.0])


def test_options_between_arguments(zenoh_tf: Run, recording: Path) -> None:
    words = f"query {recording} --at 7.51s odom --json camera"
    assert document(zenoh_tf(*words.split()))["translation"] == pytest.approx([26.5, 0.0, 0.0])
    done = zenoh_tf(*f"query --at 7.51s {recording} -- odom camera --json".split())
    assert done.returncode == 2 and "unrecognized arguments: --json" in done.stderr


def test_signs_count_from_the_recording_not_from_the_pair(zenoh_tf: Run, tmp_path: Path) -> None:
    log: Log = [
        (1.0, "/tf", [("a", "b", 5.0, 0.0), ("a", "c", 10.0, 0.0), ("a", "c", 12.0, 2.0)]),
        (2.0, "/tf", [("a", "b", 20.0, 0.0)]),
    ]
    path = str(write(tmp_path / "log", log))
    for at in ("+6s", "-9s"):
        answer = document(zenoh_tf("query", path, "a", "c", "--at", at, "--json"))
        assert answer["stamp_ns"] == 11_000_000_000
        assert answer["translation"][0] == pytest.approx(1.0)


def test_without_a_time(zenoh_tf: Run, recording: Path) -> None:
    """At the latest common time, as lookup; links that are all static need none."""
    answer = document(zenoh_tf("--json", "query", str(recording), "odom", "camera"))
    assert answer["stamp_ns"] == 8_000_000_000
    text = succeeds(zenoh_tf("query", str(recording), "base", "camera"))
    assert text.splitlines()[0] == "camera in base"
    assert "x   1.000000" in text


def test_every_step_as_csv(zenoh_tf: Run, recording: Path) -> None:
    asked = ("query", str(recording), "odom", "camera", "--every", "20ms", "--csv")
    rows = [*csv.DictReader(io.StringIO(succeeds(zenoh_tf(*asked))))]
    assert [int(row["stamp_ns"]) for row in rows] == [
        7_000_000_000 + i * 20_000_000 for i in range(51)
    ]
    assert [float(row["x"]) for row in rows] == pytest.approx([1.0 + i for i in range(51)])
    assert [*rows[0]] == ["stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw"]
    assert rows[0]["qw"] == "1.0"


def test_every_step_for_reading_and_as_json(zenoh_tf: Run, recording: Path) -> None:
    asked = ("query", str(recording), "odom", "base", "--every", "500ms")
    header, *lines = succeeds(zenoh_tf(*asked)).splitlines()
    assert header.split() == ["time", "[s]", "x", "y", "z", "qx", "qy", "qz", "qw"]
    assert lines[1].split()[:2] == ["7.500000000", "25.000000"]
    answers = document(zenoh_tf(*asked, "--json"))
    assert [answer["translation"][0] for answer in answers] == pytest.approx([0.0, 25.0, 50.0])


def test_times_that_have_no_answer_are_left_out_and_counted(zenoh_tf: Run, recording: Path) -> None:
    asked = ("query", str(recording), "odom", "base", "--every", "500ms", "--csv")
    done = zenoh_tf(*asked, "--start", "6s", "--end", "7.5s")
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) == 3
    assert done.stderr == "zenoh-tf: no answer at 2 of 4 times, which are left out\n"
    line = refusal(zenoh_tf(*asked, "--start", "1s", "--end", "2s"))
    assert "BackwardExtrapolationException" in line
    assert "too early" in line


def test_frames_without_knowing_any(zenoh_tf: Run, recording: Path) -> None:
    first, _, *lines = succeeds(zenoh_tf("query", str(recording))).splitlines()
    assert first == "7.000000000 s to 8.000000000 s (1.0 s)"
    assert [line.split()[:2] for line in lines] == [
        ["odom"],
        ["└─", "base"],
        ["└─", "camera"],
        ["odom2"],
        ["└─", "base2"],
    ]
    frames = document(zenoh_tf("query", str(recording), "--json"))["frames"]
    assert {frame["name"] for frame in frames} == {"odom", "base", "camera", "odom2", "base2"}


def test_a_recording_that_begins_at_zero(zenoh_tf: Run, tmp_path: Path) -> None:
    """As those of simulators do."""
    log: Log = [(1.0, "/tf", [("a", "b", 0.0, 1.0), ("a", "b", 2.0, 3.0)])]
    path = str(write(tmp_path / "log", log))
    assert succeeds(zenoh_tf("query", path)).startswith("0.000000000 s to 2.000000000 s (2.0 s)\n")
    rows = succeeds(zenoh_tf("query", path, "a", "b", "--every", "1s", "--csv")).splitlines()
    assert [row.split(",")[:2] for row in rows[1:]] == [
        ["0", "1.0"],
        ["1000000000", "2.0"],
        ["2000000000", "3.0"],
    ]


def test_chosen_topics(zenoh_tf: Run, recording: Path) -> None:
    answer = zenoh_tf("query", str(recording), "--topic", "/robot2/tf", "--json")
    assert {frame["name"] for frame in document(answer)["frames"]} == {"odom2", "base2"}
    line = refusal(zenoh_tf("query", str(recording), "--topic", "/tf2"))
    assert "these have: '/robot2/tf', '/tf', '/tf_static'" in line


def test_errors_are_one_line(zenoh_tf: Run, recording: Path, tmp_path: Path) -> None:
    file = str(recording)
    rows = [("a", "b", float(i), 1.0) for i in range(1000)]
    large = str(write(tmp_path / "large", [(1.0, "/tf", rows)]))
    for arguments, message in (
        ((file, "odom", "nope"), "LookupException: frame 'nope' does not exist"),
        ((file, "odom", "odom2"), "ConnectivityException"),
        ((file, "odom", "base", "--at", "99s"), "too late"),
        ((file, "odom", "base", "--at", "+9223372036s"), "64 bits of nanoseconds"),
        ((file, "odom", "base", "--every", "1s", "--end", "+9223372036s"), "64 bits of nanosec"),
        ((file, "base", "camera", "--every", "1s"), "are static"),
        ((file, "odom", "base", "--every", "1ns"), "more than 10,000,000"),
        ((file, "odom", "base", "--every", "1s", "--end", "1s"), "--end (1.000000000 s) is before"),
        ((large, "--max-memory", "64K"), "allow more by --max-memory"),
        ((str(tmp_path / "no.mcap"),), "no such file"),
    ):
        assert message in refusal(zenoh_tf("query", *arguments))


def test_progress_bar_on_a_terminal(recording: Path, in_terminal: Callable[..., str]) -> None:
    output = in_terminal("query", str(recording), "odom", "base")
    assert "100 %" in output
    assert "█" in output


def test_a_damaged_tail_is_reported(zenoh_tf: Run, tmp_path: Path) -> None:
    log: Log = [(float(i), "/tf", [("a", "b", float(i), 1.0)]) for i in range(100)]
    path = write(tmp_path / "log", log, kind="ros1")
    path.write_bytes(path.read_bytes()[:3000])
    done = zenoh_tf("query", str(path), "a", "b")
    assert done.returncode == 0
    assert done.stderr == "zenoh-tf: log lacks its end; what is complete was read\n"


@needs_recording
def test_a_recording_that_no_one_prepared(zenoh_tf: Run) -> None:
    answer = document(zenoh_tf("query", str(RUN), "map", "oakd_link", "--at", "+10s", "--json"))
    assert answer["stamp_ns"] == 938_800_000_000


def test_the_velocity_in_a_recording(zenoh_tf: Run, recording: Path) -> None:
    path = str(recording)
    asked = ("velocity", path, "base", "odom", "--interval", "100ms")
    answer = document(zenoh_tf(*asked, "--at", "+500ms", "--json"))
    assert answer["linear"] == pytest.approx([50, 0, 0])
    assert answer["stamp_ns"] == 7_500_000_000
    assert "m/s" in succeeds(zenoh_tf(*asked))
    static = succeeds(zenoh_tf("velocity", path, "camera", "base"))
    assert static.splitlines()[1].split() == ["time", "static"]
    assert "time         static" in succeeds(zenoh_tf("query", path, "base", "camera"))
    line = refusal(zenoh_tf(*asked, "--at", "10s"))
    assert "the stamp 10.000000000 s, but the recording is from" in line
    line = refusal(zenoh_tf("velocity", path, "base", "nowhere"))
    assert "LookupException" in line


@pytest.mark.parametrize(("count", "step_ns"), [(3, 500_000_000), (5, 250_000_000)])
def test_so_many_times(zenoh_tf: Run, recording: Path, count: int, step_ns: int) -> None:
    answers = document(
        zenoh_tf("query", str(recording), "odom", "camera", "--count", str(count), "--json")
    )
    stamps = [answer["stamp_ns"] for answer in answers]
    assert stamps == [7_000_000_000 + n * step_ns for n in range(count)]


def test_a_stamp_as_json_prints_it(zenoh_tf: Run, tmp_path: Path) -> None:
    log: Log = [(1.0, "/tf", [("a", "b", 1_700_000_000.25, 1.0)])]
    path = str(write(tmp_path / "log", log))
    answer = document(zenoh_tf("query", path, "a", "b", "--at", "1700000000250000000", "--json"))
    assert answer["stamp_ns"] == 1_700_000_000_250_000_000
