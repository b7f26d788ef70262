"""Public reports about recordings: their clocks, their order, their damage, their faults."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType, Writer

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
