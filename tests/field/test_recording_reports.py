"""Public reports about recordings: their clocks, their order, their damage, their faults."""

from __future__ import annotations

import contextlib
import csv
import json
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1

from tests.recordings.files import TF, Log, _ros_message, _store, write
from tests.support import command_line

S = 10**9
Capture = pytest.CaptureFixture[str]


def query(capsys: Capture, path: Path, *args: str) -> Any:
    """What ``zenoh-tf query FILE ... --json`` prints."""
    done = command_line.call(capsys, "query", str(path), *args, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def x_at(capsys: Capture, path: Path, at: str, *frames: str) -> float:
    return float(query(capsys, path, *frames, "--at", at)["translation"][0])


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag", "json"])
@pytest.mark.parametrize("start_s", [132.69, 0.0])
def test_stamps_of_a_simulator_in_a_log_of_wall_time(
    tmp_path: Path, capsys: Capture, kind: str, start_s: float
) -> None:
    """MichaelGrupp/evo#771: the log is of 2026 and the stamps count from a simulator's start; every
    pose is there, and relative times count from the first stamp."""
    wall_s = 1_778_226_718.0
    log: Log = [
        (wall_s, "/tf_static", [("base", "lidar", start_s, 1.0)]),
        *(
            (wall_s + i / 50, "/tf", [("local", "base", start_s + i / 50, float(i))])
            for i in range(101)
        ),
    ]
    path = write(tmp_path / "sim", log, kind=kind)
    assert x_at(capsys, path, "+1s", "local", "lidar") == pytest.approx(51)
    done = command_line.call(
        capsys, "query", str(path), "local", "lidar", "--every", "500ms", "--csv"
    )
    rows = [*csv.DictReader(done.stdout.splitlines())]
    assert [float(row["x"]) for row in rows] == pytest.approx([1, 26, 51, 76, 101])


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
@pytest.mark.parametrize("order", ["halves", "backwards", "woven"])
def test_a_file_that_is_not_in_the_order_of_its_stamps(
    tmp_path: Path, capsys: Capture, kind: str, order: str
) -> None:
    """MichaelGrupp/evo#486: two recordings that were joined in the wrong order."""
    numbers = [*range(40)]
    match order:
        case "halves":
            numbers = numbers[20:] + numbers[:20]
        case "backwards":
            numbers.reverse()
        case "woven":
            numbers = [n for pair in zip(numbers[20:], numbers[:20], strict=True) for n in pair]
    log: Log = [
        (100 + place / 10, "/tf", [("odom", "base", 50 + n / 10, float(n))])
        for place, n in enumerate(numbers)
    ]
    path = write(tmp_path / "joined", log, kind=kind)
    for at, x in (("50s", 0), ("51.25s", 12.5), ("53.9s", 39)):
        assert x_at(capsys, path, at, "odom", "base") == pytest.approx(x)


@pytest.mark.parametrize("times", [2, 5])
@pytest.mark.parametrize("kind", ["mcap", "protobuf"])
def test_rows_that_are_twice_in_one_message(
    tmp_path: Path, capsys: Capture, kind: str, times: int
) -> None:
    """foxglove/nuscenes2mcap#3: a converter wrote each transform of a message several times."""
    log: Log = [
        (
            100 + i,
            "/tf",
            [("odom", "base", 100 + i, float(i)), ("base", "lidar", 100 + i, 1)] * times,
        )
        for i in range(10)
    ]
    path = write(tmp_path / "log", log, kind=kind)
    assert x_at(capsys, path, "+4.5s", "odom", "lidar") == pytest.approx(5.5)


@pytest.mark.parametrize("kind", ["bag", "db3"])
def test_statics_that_come_late_and_unlatched(tmp_path: Path, capsys: Capture, kind: str) -> None:
    """introlab/rtabmap_ros#170, ros/robot_state_publisher#105: a filter lost the mark of a latched
    topic, and the clock was set between; statics hold at all times all the same."""
    drive = [(1000 + i / 10, "/tf", [("odom", "base", 40 + i / 10, float(i))]) for i in range(21)]
    log: Log = [
        *drive[:11],
        (1001.0, "/tf_static", [("base", "camera", 1_493_939_594.0, 0.5)]),
        (1001.0, "/tf_static", [("camera", "camera_optical", 1_494_031_985.0, 0.25)]),
        *drive[11:],
    ]
    path = write(tmp_path / "filtered", log, kind=kind)
    for at, x in (("40.05s", 0.5), ("42s", 20)):
        found = x_at(capsys, path, at, "odom", "camera_optical")
        assert found == pytest.approx(x + 0.75)


def mcap(
    path: Path,
    *,
    schema: str = TF,
    schema_encoding: str = "ros2msg",
    compression: CompressionType = CompressionType.ZSTD,
    little_endian: bool = True,
) -> Path:
    """Five seconds at 10 Hz in many small chunks."""
    store = _store(False)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=600, compression=compression)
        writer.start()
        channel = writer.register_channel(
            "/tf", "cdr", writer.register_schema(schema, schema_encoding, b"")
        )
        for i in range(51):
            rows = [("odom", "base", 100 + i / 10, float(i)), ("base", "lidar", 100 + i / 10, 1.0)]
            data = store.serialize_cdr(
                _ros_message(store, rows, False), TF, little_endian=little_endian
            )
            time_ns = 100 * S + i * S // 10
            writer.add_message(channel, time_ns, bytes(data), time_ns)
        writer.finish()
    return path


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize(
    ("schema", "encoding"),
    [
        (TF, "ros2idl"),
        (TF, ""),
        ("tf2_msgs/TFMessage", "ros2msg"),
        ("tf2_msgs::msg::TFMessage", "ros2idl"),
        ("tf2_msgs::msg::dds_::TFMessage_", "omgidl"),
    ],
)
def test_schemas_of_other_recorders(
    tmp_path: Path, capsys: Capture, schema: str, encoding: str, little_endian: bool
) -> None:
    """sensmore/kappe#2, foxglove/ros-foxglove-bridge#8, eProsima/DDS-Record-Replay#45: recorders of
    DDS name the same type as IDL does, and describe it in another language."""
    path = mcap(
        tmp_path / "dds.mcap",
        schema=schema,
        schema_encoding=encoding,
        little_endian=little_endian,
    )
    assert x_at(capsys, path, "+1.55s", "odom", "lidar") == pytest.approx(16.5)


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("lost", [3, 20, 900])
def test_a_file_that_ends_inside_of_its_index(
    tmp_path: Path, capsys: Capture, lost: int, compression: CompressionType
) -> None:
    """foxglove/mcap#1474, #385: the data is whole, and its index, its statistics or its last
    bytes are not; everything is read, and the damage is said."""
    path = mcap(tmp_path / "cut.mcap", compression=compression)
    path.write_bytes(path.read_bytes()[:-lost])
    done = command_line.call(capsys, "query", str(path), "odom", "lidar", "--at", "105s", "--json")
    assert json.loads(done.stdout)["translation"][0] == pytest.approx(51)
    assert "lacks its end" in done.stderr


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("chunk", [0, 5])
def test_a_chunk_that_cannot_be_decompressed(
    tmp_path: Path, capsys: Capture, chunk: int, compression: CompressionType
) -> None:
    """foxglove/mcap#1390: a disk lost some bytes in the middle; what is before and behind them is
    there, and what was lost is said."""
    path = mcap(tmp_path / "bad.mcap", compression=compression)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    index = summary.chunk_indexes[chunk]
    data = bytearray(path.read_bytes())
    end = index.chunk_start_offset + index.chunk_length
    data[end - 60 : end - 20] = b"\xff" * 40
    path.write_bytes(data)
    done = command_line.call(capsys, "query", str(path), "odom", "lidar", "--at", "104s", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["translation"][0] == pytest.approx(41)
    assert done.stderr.startswith("zenoh-tf: ")


DRIVE: Log = [(100 + i / 10, "/tf", [("odom", "base", 100 + i / 10, float(i))]) for i in range(300)]


@pytest.mark.parametrize("left", [0.5, 0.9])
def test_a_database_that_was_cut_off(tmp_path: Path, capsys: Capture, left: float) -> None:
    """ros2/rosbag2#1029, #521: "database disk image is malformed" for a file that a full disk or a
    broken copy had shortened; its rows had to be dumped by hand."""
    (file,) = write(tmp_path / "log", DRIVE, kind="db3").glob("*.db3")
    data = file.read_bytes()
    cut = tmp_path / "cut.db3"
    cut.write_bytes(data[: round(left * len(data))])
    done = command_line.call(capsys, "query", str(cut), "odom", "base", "--at", "102s", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["translation"][0] == pytest.approx(20)
    assert "cut.db3" in done.stderr and "damaged" in done.stderr


@pytest.mark.parametrize("has_metadata", [True, False])
def test_a_database_whose_log_was_not_merged(
    tmp_path: Path, capsys: Capture, has_metadata: bool
) -> None:
    """ros2/rosbag2#395, #521: a recorder that was killed leaves the newest messages in NAME.db3-wal
    and writes no metadata.yaml."""
    folder = write(tmp_path / "log", DRIVE, kind="db3")
    (file,) = folder.glob("*.db3")
    copied = tmp_path / "copied"
    copied.mkdir()
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA journal_mode = wal")
        database.execute("UPDATE messages SET timestamp = timestamp + 1")
        database.commit()
        for each in folder.iterdir():
            if has_metadata or each.suffix != ".yaml":
                shutil.copy(each, copied)
    assert any(each.suffix == ".db3-wal" and each.stat().st_size for each in copied.iterdir())
    for path in (copied, copied / file.name):
        assert x_at(capsys, path, "+2s", "odom", "base") == pytest.approx(20)


def ros1_bag(path: Path, compression: Writer1.CompressionFormat | None) -> bytes:
    """A bag of many chunks, without its index, as far as it was written before a crash."""
    store = _store(True)
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    writer.chunk_threshold = 2000
    with writer:
        connection = writer.add_connection("/tf", TF, typestore=store)
        for log_s, _, rows in DRIVE:
            data = store.serialize_ros1(_ros_message(store, rows, True), TF)
            writer.write(connection, round(log_s * S), data)
    data = path.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(data[at : at + 8], "little")
    return data[:at] + bytes(8) + data[at + 8 : index]


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat])
@pytest.mark.parametrize(("name", "lost"), [("2018.bag.active", 0), ("2018.orig.bag", 3000)])
def test_a_bag_that_needs_reindexing(
    tmp_path: Path,
    capsys: Capture,
    name: str,
    lost: int,
    compression: Writer1.CompressionFormat | None,
) -> None:
    """ros/ros_comm#1328, #2282, ros-perception/perception_pcl#50: what was recorded before the
    power went is read without `rosbag reindex`, which writes the whole file or shortens it."""
    data = ros1_bag(tmp_path / "whole.bag", compression)
    path = tmp_path / name
    path.write_bytes(data[: len(data) - lost])
    done = command_line.call(capsys, "query", str(path), "odom", "base", "--at", "+10s", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["translation"][0] == pytest.approx(100)
    assert f"{name} lacks its end" in done.stderr
