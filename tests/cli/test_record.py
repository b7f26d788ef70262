"""``zenoh-tf record`` against real servers; other libraries open what it writes."""

from __future__ import annotations

import itertools
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.servers import ServerProcess
from tests.recordings.readers import read_with_rosbags, rows
from tests.support.command_line import Run, begun
from tests.support.recorded import RUN, needs_recording, questions
from tests.support.waiting import wait_until
from zenoh_tf import LatestTransform, LookupException, StampedTransform, Transform, TransformTree
from zenoh_tf.recordings import RecordingError, open_recording
from zenoh_tf.recordings.writer import RecordingWriter
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.recorder import Recorder

from .conftest import document, refusal

TIMEOUT_S = 40.0


class RecorderProcess:
    """A running ``zenoh-tf record``."""

    def __init__(self, endpoint: str, path: Path, *flags: str) -> None:
        self.path = path
        self.process = begun("--connect", endpoint, "--json", "record", str(path), *flags)

    def wait_for(self, size: int) -> None:
        """Wait until the file has this many bytes."""
        self.wait_until(lambda: self.path.exists() and self.path.stat().st_size >= size)

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait for something that it does, while it runs."""
        wait_until(lambda: self.process.poll() is not None or condition())
        assert self.process.poll() is None, self.process.communicate()

    def stop(self, number: signal.Signals = signal.SIGINT) -> tuple[int, Any, str]:
        """Send a signal; return the exit status, the summary and its messages."""
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, json.loads(out) if out else None, err


@pytest.fixture
def recorders() -> Iterator[list[RecorderProcess]]:
    running: list[RecorderProcess] = []
    yield running
    for recorder in running:
        if recorder.process.poll() is None:
            recorder.process.kill()
            recorder.process.communicate()


def pose(x: float) -> Transform:
    return Transform((x, 0.0, 0.0), (0.0, 0.0, 0.6, 0.8))


def recorded(path: Path) -> int:
    """Samples of the dynamic frame b in a file so far."""
    try:
        return TransformTree.from_recording(path).frame("b").samples
    except (RecordingError, LookupException):
        return 0


def samples(path: Path) -> int:
    """Dynamic samples in a file so far."""
    try:
        return TransformTree.from_recording(path).stats()["samples"]
    except RecordingError:
        return 0


def wait_until_recorded(recorder: RecorderProcess, count: int) -> None:
    recorder.wait_until(lambda: recorded(recorder.path) >= count)


def same_answers(ours: TransformTree, theirs: Any, pairs: list[tuple[str, str]]) -> None:
    for target, source in pairs:
        last_ns = theirs.latest_common_time(target, source)
        assert ours.latest_common_time(target, source) == last_ns
        first_ns = theirs.frame("b").oldest_stamp_ns
        stamps_ns = np.linspace(first_ns, last_ns, 50).astype(np.int64)
        mine, other = (tree.sample(target, source, stamps_ns) for tree in (ours, theirs))
        np.testing.assert_allclose(mine.translations, other.translations, atol=1e-9)
        np.testing.assert_allclose(mine.rotations, other.rotations, atol=1e-9)


def test_stamps_that_are_further_apart_than_64_bits(
    client: TransformClient, server: ServerProcess, tmp_path: Path, recorders: list[RecorderProcess]
) -> None:
    client.set_transform(StampedTransform("a", "static", 0, pose(0.0)), static=True)
    client.set_transform(StampedTransform("a", "b", time.time_ns(), pose(0.0)))
    client.set_transform(StampedTransform("a", "c", -8 * 10**18, pose(1.0)))
    recorder = RecorderProcess(server.endpoint, tmp_path / "run.mcap")
    recorders.append(recorder)
    wait_until_recorded(recorder, 1)
    code, summary, errors = recorder.stop()
    assert (code, errors) == (0, "")
    assert summary["static"] == 1


def test_history_statics_and_every_commit(
    client: TransformClient,
    server: ServerProcess,
    tmp_path: Path,
    recorders: list[RecorderProcess],
) -> None:
    """In ROS 2's format, which other libraries open as a bag."""
    client.set_transform(StampedTransform("b", "camera", 0, pose(1.0)), static=True)
    client.set_transform(StampedTransform("a", "b", 1_000_000_000, pose(0.0)))
    client.set_transform(StampedTransform("a", "b", 2_000_000_000, pose(1.0)))
    recorder = RecorderProcess(server.endpoint, tmp_path / "run.mcap")
    recorders.append(recorder)
    wait_until_recorded(recorder, 2)
    for i in range(200):
        client.set_transforms_xact(
            [StampedTransform("a", "b", 2_000_000_000 + (i + 1) * 10**7, pose(i))]
        )
    client.set_transform(StampedTransform("b", "gripper", 0, pose(2.0)), static=True)
    wait_until_recorded(recorder, 202)
    code, summary, errors = recorder.stop()
    assert (code, errors) == (0, "")
    assert (summary["transforms"], summary["static"]) == (202, 2)
    assert summary["dropped"] == summary["missed_commits"] == summary["unrepresentable"] == 0
    assert summary["bytes"] == recorder.path.stat().st_size
    tree = TransformTree.from_recording(recorder.path)
    assert tree.frame("camera").static and tree.frame("gripper").static
    same_answers(tree, client, [("a", "b"), ("a", "camera"), ("gripper", "a")])
    with open_recording(recorder.path) as recording:
        messages = [*recording.messages()]
        assert not recording.is_cut_off
        assert recording.message_count == summary["messages"] == len(messages)
    assert [message.static for message in messages[:2]] == [True, False]  # statics first
    logged = [message.log_ns for message in messages]
    assert logged == sorted(logged)
    assert read_with_rosbags(recorder.path) == [
        (message.topic, rows(message.rows)) for message in messages
    ]


def record(path: Path, tf: TransformClient) -> int:
    """Record the history and what is then written at least ten times. Returns how many commits it
    missed: if any, it has the history of a second snapshot, too."""
    recorder = Recorder(tf, RecordingWriter(path, {}))
    recorder.wait_for_copy(TIMEOUT_S)
    count = recorder.counters.transforms
    wait_until(lambda: recorder.counters.transforms > count + 20)
    recorder.close()
    return recorder.counters.missed_commits


def test_nothing_is_recorded_twice(server: ServerProcess, tmp_path: Path) -> None:
    """The snapshot shows commits that the stream brings after it."""
    paths, stop = [tmp_path / f"{number}.mcap" for number in range(12)], threading.Event()
    whole: list[Path] = []
    with server.connect() as sensor, server.connect() as tf:

        def write() -> None:
            for stamp_ns in itertools.count(10**9):
                if stop.is_set():
                    return
                names = ["b", "c"]
                sensor.set_transforms_xact(
                    [StampedTransform("a", n, stamp_ns, pose(1)) for n in names]
                )

        writer = threading.Thread(target=write)
        writer.start()
        try:
            whole += [path for path in paths if record(path, tf) == 0]
        finally:
            stop.set()
            writer.join()
    assert whole
    for path in whole:
        tree = TransformTree.from_recording(path)
        for name in ("b", "c"):
            facts = tree.frame(name)
            assert facts.oldest_stamp_ns is not None and facts.newest_stamp_ns is not None
            span = facts.newest_stamp_ns - facts.oldest_stamp_ns + 1
            assert (facts.samples, facts.rewritten) == (span, 0)  # nothing is missing, either


def test_record_replay_and_the_same_answers(
    start_server: StartServer, zenoh_tf: Run, tmp_path: Path, recorders: list[RecorderProcess]
) -> None:
    first, second = start_server("--cache-time", "1000s"), start_server("--cache-time", "1000s")
    recorder = RecorderProcess(first.endpoint, tmp_path / "run.mcap")
    recorders.append(recorder)
    with first.connect() as tf, second.connect() as other:
        recorder.wait_for(1)
        with tf.broadcaster("wheels") as wheels:
            wheels.send_static(StampedTransform("b", "camera", 5, pose(0.5)))
            for i in range(500):
                x = np.sin(i / 50)
                wheels.send(
                    [
                        StampedTransform("a", "b", i * 10**7, pose(x)),
                        StampedTransform("map", "a", i * 10**7 + 123, pose(-2 * x)),
                    ]
                )
            wait_until_recorded(recorder, 500)
        assert recorder.stop(signal.SIGTERM)[0] == 0
        document(zenoh_tf("--connect", second.endpoint, "--json", "replay", str(recorder.path)))
        for source in ("a", "b", "camera"):
            last_ns = tf.latest_common_time("map", source)
            assert other.latest_common_time("map", source) == last_ns
            stamps_ns = np.linspace(123, 4_990_000_000, 500).astype(np.int64)
            mine, theirs = (each.sample("map", source, stamps_ns) for each in (other, tf))
            assert theirs.ok.all()
            np.testing.assert_allclose(mine.translations, theirs.translations, atol=1e-9)
            np.testing.assert_allclose(mine.rotations, theirs.rotations, atol=1e-9)
            newest: list[LatestTransform] = [
                each.lookup_latest_transform_xact("map", source) for each in (other, tf)
            ]
            assert newest[0].newest_stamp_ns == newest[1].newest_stamp_ns


@needs_recording
def test_a_recording_of_a_replay_gives_tf2s_answers(
    start_server: StartServer, zenoh_tf: Run, tmp_path: Path, recorders: list[RecorderProcess]
) -> None:
    server = start_server("--cache-time", "1000s")
    recorder = RecorderProcess(server.endpoint, tmp_path / "run.mcap")
    recorders.append(recorder)
    recorder.wait_for(1)
    document(zenoh_tf("--connect", server.endpoint, "--json", "replay", str(RUN)))
    recorder.wait_until(lambda: samples(recorder.path) >= 7284)
    code, summary, _ = recorder.stop()
    assert (code, summary["transforms"], summary["static"]) == (0, 7284, 29)
    tree = TransformTree.from_recording(recorder.path)
    for question in questions():
        question.check(question.ask(tree))


def test_a_killed_recorder_loses_nothing_that_was_in_the_file(
    client: TransformClient,
    server: ServerProcess,
    zenoh_tf: Run,
    tmp_path: Path,
    recorders: list[RecorderProcess],
) -> None:
    recorder = RecorderProcess(server.endpoint, tmp_path / "run.mcap")
    recorders.append(recorder)
    client.set_transform(StampedTransform("b", "camera", 0, pose(1.0)), static=True)
    stamps = itertools.count()
    while (seen := recorded(recorder.path)) < 200:  # while it runs, every second
        client.set_transform(StampedTransform("a", "b", next(stamps), pose(0.0)))
        assert recorder.process.poll() is None
    recorder.process.kill()
    recorder.process.communicate()
    kept = recorded(recorder.path)
    with open_recording(recorder.path) as recording:
        assert recording.is_cut_off
    tree = TransformTree.from_recording(recorder.path)
    assert tree.frame("camera").static
    # Nothing is missing in between.
    assert tree.frame("b").newest_stamp_ns == kept - 1
    assert kept >= seen
    done = zenoh_tf("query", str(recorder.path), "a", "camera")
    assert (done.returncode, done.stderr) == (
        0,
        "zenoh-tf: run.mcap lacks its end; what is complete was read\n",
    )
    with recorder.path.open("rb") as file:  # the library reads it, too
        found = 0
        try:
            for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                found += 1
        except Exception as error:
            assert type(error).__name__ == "EndOfFile"
    assert found > 1


def test_another_server_takes_over(
    start_server: StartServer, tmp_path: Path, recorders: list[RecorderProcess]
) -> None:
    server = start_server()
    recorder = RecorderProcess(server.endpoint, tmp_path / "run.mcap")
    recorders.append(recorder)
    with server.connect() as tf:
        tf.set_transform(StampedTransform("a", "b", 1, pose(1.0)))
    wait_until_recorded(recorder, 1)
    server.kill()
    server = start_server(endpoint=server.endpoint)
    with server.connect() as tf:
        tf.set_transform(StampedTransform("a", "b", 2, pose(2.0)))
        tf.clear()
        tf.set_transform(StampedTransform("a", "b", 3, pose(2.0)))
        wait_until_recorded(recorder, 2)
        tf.set_transform(StampedTransform("a", "b", 9, pose(2.0)))
        recorder.wait_until(
            lambda: TransformTree.from_recording(recorder.path).frame("b").newest_stamp_ns == 9
        )
    code, summary, errors = recorder.stop()
    assert (code, summary["servers"]) == (0, 2)
    assert "another server has the tree; recording continues" in errors


def test_another_server_whose_commits_are_fewer(start_server: StartServer, tmp_path: Path) -> None:
    """Its numbers begin again, so what the first server's snapshot had says nothing of it."""
    server = start_server()
    with server.connect() as tf:
        for stamp_ns in range(1, 9):
            tf.set_transform(StampedTransform("a", "b", stamp_ns, pose(1.0)))
        recorder = Recorder(tf, RecordingWriter(tmp_path / "run.mcap", {}))
        recorder.wait_for_copy(TIMEOUT_S)
        server.kill()
        server = start_server(endpoint=server.endpoint)
        wait_until(lambda: recorder.counters.servers == 2)
        with server.connect() as other:
            other.set_transform(StampedTransform("a", "b", 9, pose(1.0)))
            other.set_transform(StampedTransform("a", "b", 10, pose(1.0)))
        wait_until(lambda: recorder.counters.transforms == 10)
        recorder.close()
    assert TransformTree.from_recording(tmp_path / "run.mcap").frame("b").samples == 10


def test_what_the_format_cannot_hold_is_counted(
    client: TransformClient,
    server: ServerProcess,
    tmp_path: Path,
    recorders: list[RecorderProcess],
) -> None:
    """ROS 2 has 32 bits for the seconds of a stamp."""
    recorder = RecorderProcess(server.endpoint, tmp_path / "run.mcap")
    recorders.append(recorder)
    far_ns = -(2**33) * 10**9
    client.set_transforms_xact(
        [StampedTransform("a", f"c{i}", far_ns, pose(1.0)) for i in range(3)]
        + [StampedTransform("a", "b", 1, pose(1.0))]
    )
    wait_until_recorded(recorder, 1)
    client.remove_frame("c0")
    client.set_transform(StampedTransform("a", "b", 2, pose(1.0)))
    wait_until_recorded(recorder, 2)
    _, summary, _ = recorder.stop()
    assert summary["unrepresentable"] == 3
    assert summary["transforms"] == 2
    assert summary["removals"] == 1


def test_it_ends_by_itself(server: ServerProcess, zenoh_tf: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    done = zenoh_tf("--connect", server.endpoint, "record", str(path), "--for", "0.5s")
    assert done.returncode == 0
    assert done.stderr == f"recording to {path} until 0.5 s have passed, or Ctrl-C\n"
    assert done.stdout.startswith("0 transforms and 0 static ones in ")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None


def test_it_overwrites_nothing(server: ServerProcess, zenoh_tf: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("precious")
    run = ("--connect", server.endpoint, "record")
    assert "the file exists" in refusal(zenoh_tf(*run, str(path)))
    assert path.read_text() == "precious"
    missing = tmp_path / "no" / "run.mcap"
    assert f"{missing}: cannot be written" in refusal(zenoh_tf(*run, str(missing)))


def test_without_a_server_there_is_no_file(zenoh_tf: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    connect = ("--connect", "tcp/127.0.0.1:1", "--timeout", "1s")
    assert "ServerUnavailable" in refusal(zenoh_tf(*connect, "record", str(path)))
    assert not path.exists()


def test_a_full_disk_is_reported_and_the_file_is_readable(
    client: TransformClient, server: ServerProcess, tmp_path: Path
) -> None:
    """A limit on the size of files stands for the disk."""
    path = tmp_path / "run.mcap"
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000)); "
        "from zenoh_tf_tools.cli.main import main; sys.exit(main())"
    )
    command = [sys.executable, "-c", code, "--connect", server.endpoint, "record", str(path)]
    with forks.Popen(command, stderr=subprocess.PIPE) as process:
        deadline_s = time.monotonic() + TIMEOUT_S
        client.set_transform(StampedTransform("a", "b", 0, pose(1.0)))
        while recorded(path) < 1:
            assert process.poll() is None
            time.sleep(0.05)
        stamp_ns = 1
        generator = np.random.default_rng(18)  # what cannot be compressed
        while process.poll() is None:
            x = float(generator.random())
            client.set_transform(StampedTransform("a", "b", stamp_ns, pose(x)))
            stamp_ns += 1
            assert time.monotonic() < deadline_s
        assert process.stderr is not None
        errors = process.stderr.read()
    assert process.returncode == 1
    assert f"{path}: cannot be written: File too large; what it has can be read" in errors
    assert recorded(path) >= 1
