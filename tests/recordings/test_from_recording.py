"""`TransformTree.from_recording`: every kind of file, and damaged ones."""

from __future__ import annotations

import logging
import random
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter

from tests.support.recorded import RUN, needs_recording, questions
from zenoh_tf import ForwardExtrapolationException, LimitExceeded, TransformException, TransformTree
from zenoh_tf.recordings import RecordingError, open_recording

from .files import KINDS, LOG, TF, Log, malformed_cdr, write

S = 10**9


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_file(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path / ("log.bag" if kind == "bag" else "log"), kind=kind)
    tree = TransformTree.from_recording(path)
    assert set(tree.frames()) == {"base", "camera", "odom", "odom2", "base2"}
    assert tree.frame("camera").static
    stamps_ns = 7 * S + np.arange(0, S, S // 100)
    moved = tree.sample("odom", "camera", stamps_ns).raise_for_status()
    np.testing.assert_allclose(moved.translations[:, 0], 1 + np.arange(100) / 2, atol=1e-9)
    assert tree.lookup_transform("odom2", "base2").stamp_ns == 7 * S


def test_the_name_does_not_say_what_it_is(tmp_path: Path) -> None:
    path = write(tmp_path / "log").rename(tmp_path / "download.bin")
    assert "camera" in TransformTree.from_recording(str(path)).frames()


def test_the_whole_history_is_kept(tmp_path: Path) -> None:
    """An hour between two samples, and a simulator's restart at 3 s."""
    log: Log = [(float(i), "/tf", [("a", "b", s, s)]) for i, s in enumerate((0.0, 3600.0, 3.0))]
    tree = TransformTree.from_recording(write(tmp_path / "log", log))
    assert tree.frame("b").samples == 3
    half = tree.lookup_transform("a", "b", 1800 * S).transform.translation[0]
    assert half == pytest.approx(1800.0)


def test_statics_of_namespaces_and_of_several_publishers(tmp_path: Path) -> None:
    """Each publisher latches a message of its own; the last one comes late."""
    log: Log = [
        (1.0, "/robot1/tf_static", [("base", "camera", 0.0, 1.0)]),
        (1.0, "/tf_static", [("base", "lidar", 0.0, 2.0)]),
        (1.5, "/tf", [("odom", "base", 10.0, 0.0), ("odom", "base", 20.0, 0.0)]),
        (9.0, "/robot1/tf_static", [("base", "gripper", 99.0, 3.0)]),
    ]
    path = write(tmp_path / "log", log)
    tree = TransformTree.from_recording(path)
    for child, x in (("camera", 1.0), ("lidar", 2.0), ("gripper", 3.0)):
        for stamp_ns in (10 * S, 15 * S):
            found = tree.lookup_transform("odom", child, stamp_ns)
            assert found.transform.translation[0] == x
    chosen = TransformTree.from_recording(path, topics=["/tf", "/tf_static"])
    assert set(chosen.frames()) == {"odom", "base", "lidar"}
    with pytest.raises(RecordingError, match="these have: '/robot1/tf_static', '/tf', '/tf_stat"):
        TransformTree.from_recording(path, topics=["/robot2/tf"])


def test_no_error_advises_to_wait(tmp_path: Path) -> None:
    """Nothing will come."""
    tree = TransformTree.from_recording(write(tmp_path / "log"))
    with pytest.raises(ForwardExtrapolationException, match=r"\(50 ms too late\)$"):
        tree.lookup_transform("odom", "base", 8 * S + S // 20)


def test_a_link_that_turns_around(tmp_path: Path) -> None:
    """First a is the parent of b, then b of a: a loop only if they were simultaneous."""
    log: Log = [
        (1.0, "/tf", [("world", "a", 1.0, 1.0), ("a", "b", 1.0, 1.0)]),
        (2.0, "/tf", [("world", "b", 2.0, 3.0), ("b", "a", 2.0, 1.0)]),
    ]
    tree = TransformTree.from_recording(write(tmp_path / "log", log))
    assert tree.lookup_latest_transform("world", "a").transform.translation[0] == 4.0
    assert tree.lookup_transform("world", "b", 1 * S).transform.translation[0] == 2.0


def test_a_link_that_is_static_and_then_moves(tmp_path: Path) -> None:
    log: Log = [
        (float(i), "/tf_static" if i % 2 else "/tf", [("a", "b", 1.0 + i, float(i))])
        for i in range(7)
    ]
    tree = TransformTree.from_recording(write(tmp_path / "log", log))
    assert not tree.frame("b").static
    assert tree.lookup_latest_transform("a", "b").transform.translation[0] == 6.0


def test_what_no_tree_accepts_is_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    bad = [("a", "a", 1.0, 1.0), ("a", "b", 1.0, float("nan")), ("", "c", 1.0, 1.0)]
    log: Log = [
        (float(i), "/tf", [("a", "b", 1.0 + i, 1.0), *(bad if i % 10 == 0 else [])])
        for i in range(100)
    ]
    with caplog.at_level(logging.WARNING, "zenoh_tf.recordings"):
        tree = TransformTree.from_recording(write(tmp_path / "log", log))
    assert tree.frame("b").samples == 100
    assert set(tree.frames()) == {"a", "b"}
    assert "30 transforms skipped" in caplog.text


def test_messages_that_cannot_be_decoded_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    good = write(tmp_path / "good", [(1.0, "/tf", [("a", "b", 1.0, 1.0)])])
    with open_recording(good) as recording:
        (raw,) = recording._raw()
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/tf", "cdr", writer.register_schema(TF, "ros2msg", b""))
        for data in (malformed_cdr(3), raw.data, b"", malformed_cdr(1 << 31)):
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    with open_recording(path) as recording:
        (message,) = recording.messages()
        assert message.rows.names == ["a", "b"]
        assert recording.malformed == 3
        (warning,) = recording.warnings()
        assert warning.startswith("3 messages skipped, which cannot be decoded (/tf: CDR field ")


def test_chunks_that_overlap_are_read_in_the_order_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=1)
        writer.start()
        channel = writer.register_channel("/tf", "cdr", writer.register_schema(TF, "ros2msg", b""))
        times = [*range(100)]
        random.Random(1).shuffle(times)
        for time_ns in times:
            writer.add_message(channel, time_ns, b"\0\1\0\0\0\0\0\0", time_ns)
        writer.finish()
    with open_recording(path) as recording:
        assert [message.log_ns for message in recording.messages()] == [*range(100)]
        assert recording.message_count == 100


def test_memory_is_bounded(tmp_path: Path) -> None:
    log: Log = [(float(i), "/tf", [("a", "b", float(i), 1.0)] * 100) for i in range(100)]
    log = [
        (t, topic, [(p, c, s + i / 1000, x) for i, (p, c, s, x) in enumerate(rows)])
        for t, topic, rows in log
    ]
    path = write(tmp_path / "log", log)
    assert TransformTree.from_recording(path).frame("b").samples == 10_000
    with pytest.raises(LimitExceeded, match="the limit of 100,000 bytes") as caught:
        TransformTree.from_recording(path, max_memory_bytes=100_000)
    assert caught.value.field == "max_memory"


def _write(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def test_a_file_that_was_cut_off_is_read_up_to_there(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Every length of a file either is a prefix of the transforms, or one clear error."""
    path = write(tmp_path / "log", kind="ros1")  # with a chunk for every few messages
    data = path.read_bytes()
    found = set()
    for length in [*range(9, len(data) - 1, 97), len(data) - 1]:
        short = _write(tmp_path / f"short{length}", data[:length])
        try:
            tree = TransformTree.from_recording(short)
        except RecordingError as error:
            assert str(error).startswith(f"{short}: ")
            assert "\n" not in str(error)
        else:
            found.add(tree.frame("base").samples if "base" in tree.frames() else 0)
            assert "lacks its end" in caplog.text
        short.unlink()
    assert len(found) > 10
    assert max(found) == 51


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag", "unchunked"])
def test_damaged_files_give_one_clear_error(tmp_path: Path, kind: str) -> None:
    """Any byte may be wrong: then there is an error of one line, or a tree."""
    path = write(tmp_path / ("log.bag" if kind == "bag" else "log"), kind=kind)
    if kind == "db3":
        path = next(path.glob("*.db3"))
    data = path.read_bytes()
    seeded = random.Random(18)
    for trial in range(60):
        spoiled = bytearray(data)
        for _ in range(seeded.choice((1, 1, 20))):
            spoiled[seeded.randrange(len(spoiled))] = seeded.randrange(256)
        if trial % 4 == 0:
            del spoiled[seeded.randrange(len(spoiled)) :]
        damaged = _write(tmp_path / f"damaged{trial}{path.suffix}", bytes(spoiled))
        try:
            TransformTree.from_recording(damaged)
        except RecordingError as error:
            assert str(error).startswith(f"{damaged}: ")
            assert len(str(error).splitlines()) == 1
        except TransformException as error:
            raise AssertionError(f"{error!r} is not about the file") from error


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"hello", "not a recording: neither MCAP, db3 nor a ROS 1 bag"),
        (b"\x89MCAP", "not a readable recording"),
        (b"\x89MCAP0\r\n" + bytes(1000), "no message of type"),
        (b"#ROSBAG V2.0\n" + bytes(1000), "not a readable recording"),
        (b"SQLite format 3\0" + bytes(1000), "not a readable recording"),
    ],
)
def test_files_that_are_no_recordings(tmp_path: Path, data: bytes, message: str) -> None:
    path = _write(tmp_path / "file", data)
    with pytest.raises(RecordingError) as caught:
        TransformTree.from_recording(path)
    assert str(caught.value).startswith(f"{path}: {message}")


def test_paths_that_are_no_files(tmp_path: Path) -> None:
    for path, message in ((tmp_path, "not a readable"), (tmp_path / "no", "no such file")):
        with pytest.raises(RecordingError, match=message):
            TransformTree.from_recording(path)


def test_a_folder_whose_recorder_was_killed(tmp_path: Path) -> None:
    """It has no metadata.yaml, and the last file no end."""
    write(tmp_path / "a", LOG).rename(tmp_path / "log_2.mcap")
    last: Log = [(200.0, "/tf", [("odom", "base", 30.0, 1.0)])]
    write(tmp_path / "b", last).rename(tmp_path / "log_10.mcap")
    with open_recording(tmp_path) as recording:
        logged = [message.log_ns for message in recording.messages()]
    assert logged == sorted(logged)
    assert TransformTree.from_recording(tmp_path).frame("base").newest_stamp_ns == 30 * S


@pytest.mark.parametrize(("library", "kind"), [("mcap", "mcap"), ("rosbags", "bag")])
def test_without_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str, kind: str
) -> None:
    path = write(tmp_path / ("log.bag" if kind == "bag" else "log"), kind=kind)
    for name in [name for name in sys.modules if name.split(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(RecordingError, match=r"pip install 'zenoh-tf\[recordings\]'"):
        TransformTree.from_recording(path)


@needs_recording
def test_every_recorded_answer_agrees_with_tf2() -> None:
    tree = TransformTree.from_recording(RUN)
    assert len(questions()) > 1700
    for question in questions():
        question.check(question.ask(tree))


def test_a_tree_of_what_was_known_at_a_time(tmp_path: Path) -> None:
    """Samples are recorded 50 ms late, and the static link before them."""
    log: Log = [(10.05 + i / 10, "/tf", [("a", "b", 10.0 + i / 10, i / 10)]) for i in range(100)]
    path = write(tmp_path / "log", [(9.0, "/tf_static", [("b", "c", 0.0, 1.0)]), *log])
    now_ns = 15 * S
    tree = TransformTree.from_recording(path, until_ns=now_ns)
    assert tree.frame("b").newest_stamp_ns == now_ns - S // 10
    found = tree.estimate_transform("a", "c")
    assert (found.stamp_ns, found.by_ns) == (now_ns, S // 10)
    assert found.transform.translation[0] == pytest.approx(6.0)
    assert tree.estimate_transforms("a", ["c"], None).stamps_ns.tolist() == [now_ns]
    assert TransformTree.from_recording(path, until_ns=9 * S).frames() == ["c", "b"]
    with pytest.raises(RecordingError, match="nothing was recorded by 8"):
        TransformTree.from_recording(path, until_ns=8 * S)
