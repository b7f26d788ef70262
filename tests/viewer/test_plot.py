"""``zenoh-tf plot``: its figures' data, and every documented line."""

from __future__ import annotations

import json
import re
import shlex
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.recordings.files import write
from tests.support.command_line import call, documented
from tests.support.threads import beside
from zenoh_tf import LookupException, StampedTransform, Transform
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings import open_recording
from zenoh_tf.recordings.writer import RecordingWriter
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.plotting.lookups import PairHistory, follow, pose_error, replayed
from zenoh_tf_tools.viewer.recorded import RecordedSource

PAGE = Path(__file__).parents[2] / "docs/how-to/view.md"
S = 10**9


@pytest.fixture(autouse=True)
def settings() -> Iterator[None]:
    """Matplotlib's defaults: another test of the process may have imported other settings."""
    matplotlib = pytest.importorskip("matplotlib")
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        yield


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """map -> base_link from 1 s to 6 s and from 8 s to 9 s, base_link -> wheel from 2 s to 9 s;
    map -> truth as base_link."""
    base = [(i / 10, "/tf", [("map", "base_link", 1 + i / 10, i / 10)]) for i in range(51)]
    again = [(i / 10, "/tf", [("map", "base_link", 1 + i / 10, i / 10)]) for i in range(70, 81)]
    wheel = [(9.0, "/tf", [("base_link", "wheel", 2 + i / 10, 1.0)]) for i in range(71)]
    static = [(0.0, "/tf_static", [("base_link", "camera", 0.0, 1.0)])]
    folder = tmp_path_factory.mktemp("recording")
    truth = [(i / 10, "/tf", [("map", "truth", 1 + i / 10, i / 10)]) for i in range(81)]
    path = write(folder / "run", [*static, *base, *again, *wheel, *truth])
    return path.rename(folder / "run.mcap")


@pytest.fixture
def published(server: ServerProcess) -> Iterator[TransformClient]:
    """map -> base_link all the time, base_link -> stopped 5 s ago."""
    with server.connect() as tf:
        old_ns = time.time_ns() - 5 * S
        tf.set_transform(StampedTransform("base_link", "stopped", old_ns, Transform((0, 3, 0))))

        def publish(ending: threading.Event) -> None:
            sensor = tf.broadcaster("sensor")
            while not ending.wait(0.01):
                sensor.send(StampedTransform("map", "base_link", time.time_ns(), Transform()))

        with beside(publish):
            while not tf.can_transform("map", "base_link"):
                time.sleep(0.01)
            yield tf
        tf.clear(keep_static=False)


def replay(path: Path, target: str, source: str, **options: Any) -> PairHistory:
    with open_recording(path) as recording:
        tree = RecordedSource(recording)
    (history,) = replayed(tree, [(target, source)], tree.range_ns, **options)
    return history


def at(history: PairHistory, second: float) -> int:
    """The row of the time nearest to this many seconds after the first sample."""
    return int(np.abs(history.times_s - second).argmin())


def test_a_recorded_pair(recording: Path) -> None:
    history = replay(recording, "map", "camera")
    assert history.answered.all()
    assert history.error is None
    row = at(history, 3.05)
    assert history.poses[row, 0] == pytest.approx(history.times_s[row] + 1.0)
    assert history.ages_s[row] == pytest.approx(0.05, abs=0.01)
    # In the gap the pose is interpolated, and the age says that it is.
    row = at(history, 6.5)
    assert history.poses[row, 0] == pytest.approx(7.5, abs=0.01)
    assert history.ages_s[row] == pytest.approx(1.5, abs=0.01)


def test_times_without_an_answer(recording: Path) -> None:
    history = replay(recording, "map", "wheel")
    assert not history.answered[at(history, 0.5)]
    assert np.isnan(history.ages_s[at(history, 0.5)])
    assert history.answered[at(history, 1.5)]
    assert "'wheel'" in str(history.error)
    assert replay(recording, "base_link", "camera").answered.all()
    assert np.isnan(replay(recording, "base_link", "camera").ages_s).all()  # static


def test_a_live_pair(published: TransformClient) -> None:
    with published.mirror() as mirror:
        pairs = [("map", "stopped"), ("map", "base_link")]
        history, moving = follow(mirror, pairs, 0.2, velocity=True)
        assert moving.velocities is not None
        assert np.nanmax(np.abs(moving.velocities)) == 0
        np.testing.assert_array_equal(moving.stamps_ns, history.stamps_ns)
        assert history.answered.all()
        np.testing.assert_allclose(history.poses[:, :3], [[0, 3, 0]] * len(history.poses))
        assert 5 <= history.ages_s.min() <= history.ages_s.max() < 60
        assert np.all(np.diff(history.times_s) > 0)
        (unknown,) = follow(mirror, [("map", "nowhere")], 0.0)
        assert len(unknown.times_s) == 1
        assert isinstance(unknown.error, LookupException)


def test_figures_with_any_name(tmp_path: Path) -> None:
    from zenoh_tf_tools.plotting.figure import save  # noqa: PLC0415 - seconds, for one test

    nothing = np.full((3, 7), np.nan)
    poses = np.array([[1.0, 2, 3, 0, 0, 0, 1]] * 3)
    poses[1] = np.nan
    stamps_ns, ages_s = np.arange(3) * S, np.array([0.0, np.nan, -1.0])
    for rows, ages, target, source in (
        (poses, ages_s, "$x_{", "\\frac"),
        (nothing, nothing[:, 0], "a\u202eb", "x" * 500),
    ):
        pair = PairHistory(target, source, stamps_ns, rows, ages, rows[:, :6], None)
        for pairs, error in (([pair], None), ([pair, pair], pose_error(rows, rows))):
            save(pairs, tmp_path / "plot.png", error)
            assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_the_last_sample_of_a_stamp_since_1970(tmp_path: Path) -> None:
    """A double would be up to 256 ns beside it."""
    first_ns, last_ns = 1_714_741_170_123_456_789, 1_714_741_190_987_654_321
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, {})
    for stamp_ns in (first_ns, last_ns):
        row = ("map", "base_link", stamp_ns, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
        writer.write(stamp_ns, False, TransformRows.of_tuples([row]))
    writer.close()
    history = replay(path, "map", "base_link")
    assert history.answered.all()
    assert (history.stamps_ns[0], history.stamps_ns[-1]) == (first_ns, last_ns)
    assert np.all(np.diff(history.stamps_ns) > 0)


def test_velocities(recording: Path) -> None:
    history = replay(recording, "map", "base_link", velocity=True)
    assert history.velocities is not None
    row = history.velocities[at(history, 2.0)]
    np.testing.assert_allclose(row, [1, 0, 0, 0, 0, 0], atol=1e-6)
    # The window of the first time begins before the first sample.
    assert np.isnan(history.velocities[0]).all()


def test_the_error_of_a_pair() -> None:
    turns = [Transform((0, 0, z), Transform.from_rpy(0, 0, z).rotation) for z in (0.0, 1e-9, 1.0)]
    moved = [Transform((3, 4, 0)) @ turn for turn in turns]
    flipped = [Transform(pose.translation, -pose.rotation) for pose in turns]

    def rows(poses: list[Transform]) -> np.ndarray[Any, Any]:
        return np.array([[*pose.pose()] for pose in poses])

    still = rows([Transform()] * 3)
    metres, radians = pose_error(rows(moved), rows(turns))
    np.testing.assert_allclose(metres, 5)
    np.testing.assert_allclose(radians, 0, atol=1e-12)
    # The same rotation may have either sign; small angles are kept.
    for poses in (turns, flipped):
        for pair in ((rows(poses), still), (still, rows(poses))):
            np.testing.assert_allclose(pose_error(*pair)[1], [0, 1e-9, 1], rtol=1e-6)
    nothing = rows(turns)
    nothing[1] = np.nan
    assert np.isnan(pose_error(nothing, still)[0]).tolist() == [False, True, False]


def test_angles_do_not_jump() -> None:
    from zenoh_tf_tools.plotting.figure import _angles  # noqa: PLC0415 - internal

    turns = [Transform.from_rpy(0.1, 0.2, yaw).rotation for yaw in (3.0, 3.1, 3.2, 3.3)]
    angles = _angles(np.array(turns))
    np.testing.assert_allclose(angles[:2], [[0.1, 0.2, 3.0], [0.1, 0.2, 3.1]], atol=1e-9)
    assert np.isnan(angles[2, 2])
    assert angles[3, 2] == pytest.approx(3.3 - 2 * np.pi)


def test_what_it_prints(recording: Path, tmp_path: Path, capsys: Any) -> None:
    out = str(tmp_path / "x.pdf")
    done = call(capsys, "plot", str(recording), "map", "wheel", "--out", out)
    assert done.returncode == 0
    first, second = done.stdout.splitlines()
    assert re.fullmatch(
        rf"{re.escape(out)}: 2,000 lookups over 8.0 s, age \S+ ms \(median\), 2.0 s at most", first
    )
    assert re.match(r"\d+ lookups without an answer; the last: extrapolation into the past", second)
    args = ("plot", str(recording), "base_link", "camera", "--out", out, "--json")
    document = json.loads(call(capsys, *args).stdout)
    assert (document["failed"], document["median_age_s"]) == (0, None)


def test_two_pairs_and_their_error(recording: Path, tmp_path: Path, capsys: Any) -> None:
    out = str(tmp_path / "x.svg")
    args = ("plot", str(recording), "map", "base_link", "--pair", "map", "camera", "--out", out)
    done = call(capsys, *args, "--error", "--start", "+1s", "--end", "5s")
    first, second, third = done.stdout.splitlines()
    assert first.startswith(f"{out}: 2,000 lookups over 3.0 s, age ")
    assert second.startswith("camera in map: age ")
    assert third == "error: 1 m (median), 1 m at most; 0 deg (median), 0 deg at most"
    drawn = (tmp_path / "x.svg").read_text()
    for text in ("base_link in map", "camera in map", "error [m]", "time [s] since 2.000000000 s"):
        assert f"<!-- {text} -->" in drawn
    assert "<!-- velocity [m/s] -->" not in drawn
    document = json.loads(call(capsys, *args, "--velocity", "--error", "--json").stdout)
    assert document["pair"]["source"] == "camera"
    assert (document["greatest_error_m"], document["greatest_error_deg"]) == (pytest.approx(1), 0)
    assert "<!-- velocity [m/s] -->" in (tmp_path / "x.svg").read_text()
    done = call(capsys, *args, "--error", "--end", "+0s")
    assert "1 lookups over 0.0 s" in done.stdout


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (("--out", "x.gif"), 2, "'x.gif' does not end with one of .png, .svg, .pdf"),
        (("--for", "3601s"), 2, "'3601s' is not a duration of at least 0 s and at most 3,600 s"),
        (("--pair", "map"), 2, "argument --pair: expected 2 arguments"),
        (("--pair", *"ab", "--pair", *"cd"), 2, "--pair can be given once"),
        (("--error",), 2, "--error compares two pairs: give the other one by --pair"),
        (("--for", "1s"), 2, "--for follows a server; of FILE choose times by --start and --end"),
        (("--start", "1"), 2, "'1' is ambiguous: 1 s after the recording's first stamp, or the"),
        (("--end", "now"), 2, "'now' is not a time; give +10s"),
        (("--start", "20s"), 1, "--start 20s is the stamp 20.000000000 s, but the recording is"),
        (("--start", "+3s", "--end", "+2s"), 1, "--end (3.000000000 s) is before 4.000000000 s"),
        (("--out", "/nowhere/x.png"), 1, "/nowhere/x.png: there is no folder /nowhere"),
        (("--out", "/proc/x.png"), 1, "/proc/x.png: "),
    ],
)
def test_wrong_arguments(
    args: tuple[str, ...], code: int, message: str, recording: Path, capsys: Any
) -> None:
    done = call(capsys, "plot", str(recording), "map", "wheel", *args)
    assert (done.returncode, done.stdout) == (code, "")
    assert message in done.stderr


def test_a_recording_that_is_not_there(capsys: Any) -> None:
    done = call(capsys, "plot", "nowhere.mcap", "map", "wheel")
    assert (done.returncode, done.stdout) == (1, "")
    assert "nowhere.mcap: no such file" in done.stderr


def test_a_pair_that_never_has_an_answer(recording: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "x.png"
    done = call(capsys, "plot", str(recording), "map", "nowhere", "--out", str(out))
    assert done.returncode == 1
    assert done.stderr.startswith("zenoh-tf: LookupException: ")
    assert not out.exists()


@pytest.mark.parametrize("line", documented(PAGE, "plot"))
def test_documented_lines(
    line: str,
    recording: Path,
    request: pytest.FixtureRequest,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Any,
) -> None:
    args = shlex.split(line)[1:]
    if "run.mcap" in args:
        (tmp_path / "run.mcap").symlink_to(recording)
    else:
        request.getfixturevalue("published")
        args += ["--connect", request.getfixturevalue("server").endpoint]
        args += ["--for", "0.1s"]  # the last one counts
    monkeypatch.chdir(tmp_path)
    done = call(capsys, *args)
    assert (done.returncode, done.stderr) == (0, "")
    name = args[args.index("--out") + 1] if "--out" in args else "plot.png"
    assert done.stdout.startswith(f"{name}: ")
    assert (tmp_path / name).stat().st_size > 1000
