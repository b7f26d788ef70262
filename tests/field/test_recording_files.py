"""Containers and encodings of recordings: docs/explanation/field.md, "Recordings"."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import flatbuffers
import pytest
import zstandard
from foxglove_schemas_flatbuffer import FrameTransform as OneFlat
from foxglove_schemas_flatbuffer import FrameTransforms as Flat
from foxglove_schemas_flatbuffer.Quaternion import (
    QuaternionAddW,
    QuaternionEnd,
    QuaternionStart,
)
from foxglove_schemas_flatbuffer.Time import CreateTime
from foxglove_schemas_flatbuffer.Vector3 import Vector3AddX, Vector3End, Vector3Start
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bench.large_recording import make
from tests.recordings.files import TF, write
from zenoh_tf import TransformTree
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings import RecordingError, open_recording
from zenoh_tf.recordings.load import load
from zenoh_tf.ros2.cdr import encode_tf_message

S = 10**9
COUNT = 40
#: Without it, a writer adds messages outside of chunks.
_BUILDER = "_Writer__chunk_builder"
LOG = [
    (9.0, "/tf_static", [("base", "camera", 0.0, 0.5)]),
    *((10.0 + i / 10, "/tf", [("odom", "base", 20.0 + i, 2.0 * i)]) for i in range(COUNT)),
]


def check(path: Path, samples: int = COUNT) -> None:
    tree = TransformTree.from_recording(path)
    assert tree.frame("base").samples == samples
    found = tree.lookup_transform("odom", "camera", 21 * S + S // 2)
    assert found.transform.translation[0] == pytest.approx(3.5)


def data_of(rows: list[tuple[str, str, float, float]]) -> bytes:
    return encode_tf_message(
        TransformRows.of_tuples(
            [(p, c, round(s * S), (x, 0, 0, 0, 0, 0, 1)) for p, c, s, x in rows]
        )
    )


def write_mcap(path: Path, *, compress_messages: bool = False, **options: Any) -> Path:
    """LOG by the `mcap` library, beside a topic of text in chunks of its own."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=600, **options)
        writer.start("ros2")
        text = writer.register_channel("/text", "json", 0)
        schema = writer.register_schema(TF, "ros2msg", b"")
        topics: dict[str, int] = {}
        for log_s, topic, rows in LOG:
            if topic not in topics:
                topics[topic] = writer.register_channel(topic, "cdr", schema)
            data = data_of(rows)
            data = zstandard.compress(data) if compress_messages else data
            time_ns = round(log_s * S)
            writer.add_message(topics[topic], time_ns, data, time_ns)
            writer.add_message(text, time_ns, b"x" * 300, time_ns)
        writer.finish()
    return path


@pytest.mark.parametrize("compression", CompressionType, ids=lambda each: each.name)
@pytest.mark.parametrize(
    "options",
    [
        {"repeat_channels": False, "repeat_schemas": False},
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"use_statistics": False},
        {"use_statistics": False, "repeat_schemas": False},
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.CHUNK},
        {"index_types": IndexType.MESSAGE},
        {"use_summary_offsets": False},
        {"use_chunking": False},
    ],
    ids=str,
)
def test_summaries_that_leave_parts_out(
    tmp_path: Path, options: dict[str, Any], compression: CompressionType
) -> None:
    """foxglove/mcap#1696, #1172, #1735: readers took such a summary for complete."""
    check(write_mcap(tmp_path / "log.mcap", compression=compression, **options))


def test_messages_outside_of_chunks_beside_an_index(tmp_path: Path) -> None:
    """foxglove/mcap#1696, a variant: the index has the chunks, and not what is between them."""
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=600)
        writer.start("ros2")
        schema = writer.register_schema(TF, "ros2msg", b"")
        channel = writer.register_channel("/tf", "cdr", schema)
        for number in range(2 * COUNT):
            if loose := number in (30, 31, 60):
                writer.flush()
                builder = getattr(writer, _BUILDER)
                setattr(writer, _BUILDER, None)
            data = data_of([("odom", "base", 20.0 + number / 2, float(number))])
            writer.add_message(channel, number, data, number)
            if loose:
                setattr(writer, _BUILDER, builder)
        writer.finish()
    assert TransformTree.from_recording(path).frame("base").samples == 2 * COUNT


def _compressed_file(path: Path) -> Path:
    out = path.with_name(path.name + ".zstd")
    out.write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    return out


def test_a_file_that_was_compressed_as_a_whole(tmp_path: Path) -> None:
    """ros2/rosbag2#2445: people copy `x_0.mcap.zstd` without its folder."""
    check(_compressed_file(write_mcap(tmp_path / "x_0.mcap")))
    check(_compressed_file(write_mcap(tmp_path / "y_0.mcap", use_chunking=False)))
    db3 = next(write(tmp_path / "db3", LOG, kind="db3").glob("*.db3"))
    check(_compressed_file(db3))
    named = _compressed_file(write_mcap(tmp_path / "z.mcap"))
    check(named.rename(tmp_path / "download.bin"))
    cut = tmp_path / "cut.mcap.zstd"
    content = write_mcap(tmp_path / "v.mcap", use_chunking=False).read_bytes()
    frames = [zstandard.compress(content[at : at + 500]) for at in range(0, len(content), 500)]
    cut.write_bytes(b"".join(frames[:-5])[:-9])
    with open_recording(cut) as recording:
        assert sum(len(message.rows) for message in recording.messages()) > COUNT // 2
        assert recording.is_cut_off


@pytest.mark.parametrize("plugin", StoragePlugin, ids=lambda each: each.name)
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize("part", ["folder", "file", "folder without metadata"])
def test_the_compression_of_ros2_bag(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode, part: str
) -> None:
    """ros2/rosbag2#1533, #1920, cellumation/snapshotter#11."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    folder = tmp_path / "bag"
    writer = Writer2(folder, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics: dict[str, Any] = {}
        for log_s, topic, rows in LOG:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, TF, typestore=store)
            writer.write(topics[topic], round(log_s * S), data_of(rows))
    if part != "folder":
        (folder / "metadata.yaml").unlink()
    check(next(folder.iterdir()) if part == "file" else folder)


def test_a_split_bag_of_which_a_part_is_bad(tmp_path: Path) -> None:
    """ros2/rosbag2#557, a variant: the disk was full when the last part was begun."""
    for number in range(2):
        part = [row for row in LOG[1:] if (row[0] < 12) == (number == 0)]
        folder = write(tmp_path / f"{number}", [LOG[0], *part], kind="db3")
        shutil.copy(next(folder.glob("*.db3")), tmp_path / f"run_{number}.db3")
        shutil.rmtree(folder)
    check(tmp_path)
    (tmp_path / "run_2.db3").write_bytes(b"")
    check(tmp_path)
    with open_recording(tmp_path) as recording:
        assert any("run_2.db3: the file is empty" in each for each in recording.warnings())
    check(tmp_path / "run_0.db3", samples=20)


# --- Foxglove


def _flat(rows: list[tuple[str, str, float, float]], *, one: bool = False) -> bytes:
    builder = flatbuffers.Builder(256)
    found = []
    for parent, child, stamp_s, x in rows:
        names = [builder.CreateString(name) for name in (parent, child)]
        Vector3Start(builder)
        Vector3AddX(builder, x)
        at = Vector3End(builder)
        QuaternionStart(builder)
        QuaternionAddW(builder, 1.0)
        turn = QuaternionEnd(builder)
        OneFlat.FrameTransformStart(builder)
        stamp = CreateTime(builder, int(stamp_s), round(stamp_s % 1 * 1e9))
        OneFlat.FrameTransformAddTimestamp(builder, stamp)
        OneFlat.FrameTransformAddParentFrameId(builder, names[0])
        OneFlat.FrameTransformAddChildFrameId(builder, names[1])
        OneFlat.FrameTransformAddTranslation(builder, at)
        OneFlat.FrameTransformAddRotation(builder, turn)
        found.append(OneFlat.FrameTransformEnd(builder))
    if one:
        (root,) = found
    else:
        Flat.FrameTransformsStartTransformsVector(builder, len(found))
        for each in reversed(found):
            builder.PrependUOffsetTRelative(each)
        vector = builder.EndVector()
        Flat.FrameTransformsStart(builder)
        Flat.FrameTransformsAddTransforms(builder, vector)
        root = Flat.FrameTransformsEnd(builder)
    builder.Finish(root)
    return bytes(builder.Output())


def _ros(rows: list[tuple[str, str, float, float]], *, one: bool = False) -> bytes:
    """Foxglove's messages in CDR, by the definition that its package of ROS has."""
    package = "foxglove_msgs/msg/"
    store = get_typestore(Stores.ROS2_JAZZY)
    single = "builtin_interfaces/Time timestamp\nstring parent_frame_id\nstring child_frame_id\n"
    single += "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    store.register(get_types_from_msg(single, package + "FrameTransform"))
    several = "foxglove_msgs/FrameTransform[] transforms\n"
    store.register(get_types_from_msg(several, package + "FrameTransforms"))
    kinds = store.types
    found = [
        kinds[package + "FrameTransform"](
            kinds["builtin_interfaces/msg/Time"](int(stamp_s), round(stamp_s % 1 * 1e9)),
            parent,
            child,
            kinds["geometry_msgs/msg/Vector3"](x, 0.0, 0.0),
            kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        )
        for parent, child, stamp_s, x in rows
    ]
    if one:
        return bytes(store.serialize_cdr(found[0], package + "FrameTransform"))
    message = kinds[package + "FrameTransforms"](found)
    return bytes(store.serialize_cdr(message, package + "FrameTransforms"))


@pytest.mark.parametrize("one", [False, True])
@pytest.mark.parametrize(
    ("package", "encoding", "encode"),
    [("foxglove.", "flatbuffer", _flat), ("foxglove_msgs/msg/", "cdr", _ros)],
)
def test_encodings_of_foxglove(
    tmp_path: Path, package: str, encoding: str, encode: Callable[..., bytes], one: bool
) -> None:
    """MichaelGrupp/evo#221, a variant: Foxglove's messages in flatbuffers and in CDR."""
    path = tmp_path / "log.mcap"
    name = package + ("FrameTransform" if one else "FrameTransforms")
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema(name, "", b"")
        channels = {t: writer.register_channel(t, encoding, schema) for t in ("/tf", "/tf_static")}
        for log_s, topic, rows in LOG:
            data = encode(rows, one=one)
            writer.add_message(channels[topic], round(log_s * S), data, round(log_s * S))
        for spoilt in (data[: len(data) // 2], b"", b"\xff" * 64):
            writer.add_message(channels["/tf"], 20 * S, spoilt, 20 * S)
        writer.finish()
    check(path)
    with open_recording(path) as recording:
        for _ in recording.messages():
            pass
        assert recording.malformed == 3


def test_a_compressed_file_that_is_a_bomb(tmp_path: Path) -> None:
    """Some kB that would fill a disk, or take gigabytes of memory."""
    begins = (b"SQLite format 3\0", b"\x89MCAP0\r\n\x06" + (1 << 40).to_bytes(8, "little"))
    for number, begin in enumerate(begins):
        packer = zstandard.ZstdCompressor().compressobj()
        parts = [packer.compress(begin), *(packer.compress(bytes(1 << 24)) for _ in range(40))]
        path = tmp_path / f"{number}.zstd"
        path.write_bytes(b"".join([*parts, packer.flush()]))
        with pytest.raises(RecordingError, match="damaged"):
            TransformTree.from_recording(path)


# --- large chunks


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_few_transforms_in_large_chunks(tmp_path: Path, compression: CompressionType) -> None:
    """Images and transforms are in the same chunks, as `ros2 bag record` writes them."""
    path = tmp_path / "large.mcap"
    count = make(path, 5_000_000, compression)
    tree = TransformTree.from_recording(path)
    assert tree.frame("base").samples == count == 40
    last_ns = tree.latest_common_time("map", "base")
    assert last_ns == 10**18 + 39 * 4_000_000
    found = tree.lookup_transform("map", "base", last_ns)
    assert found.transform.translation[0] == pytest.approx(0.039)


def test_progress_among_images(tmp_path: Path) -> None:
    """10 GB with 10 MB of transforms are read for seconds: a bar must move more than twice."""
    log = [(10.0 + i / 100, "/tf", [("odom", "base", 20.0 + i, 1.0)]) for i in range(10_000)]
    path = write(tmp_path / "log", log)
    done: list[int] = []
    with open_recording(path) as recording:
        load(recording, TransformTree(), done.append)
    assert len(done) >= 4
    assert done[0] <= 3000
    assert done[-1] == len(log)


def test_a_large_chunk_that_differs_from_its_index(tmp_path: Path) -> None:
    path = tmp_path / "large.mcap"
    make(path, 5_000_000)
    data = bytearray(path.read_bytes())
    # The log time of a message in the third chunk: then its checksum decides.
    message = data.index((10**18 + 20 * 4_000_000).to_bytes(8, "little"))
    data[message] ^= 1
    path.write_bytes(data)
    with open_recording(path) as recording:
        assert sum(len(message.rows) for message in recording.messages()) == 32
        (warning,) = recording.warnings()
        assert "a chunk cannot be read: its checksum is wrong" in warning


# --- damage


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("timestamp", "'x'"),
        ("timestamp", "x'00ff'"),
        ("timestamp", "1e300"),
        ("data", "3000000000"),
        ("data", "0.5"),
    ],
)
def test_rows_of_other_types(tmp_path: Path, column: str, value: str) -> None:
    """A db3 whose time is text, or whose data is a number that once became 3 GB of zeros."""
    path = next(write(tmp_path / "log", LOG, kind="db3").glob("*.db3"))
    database = sqlite3.connect(path)
    database.execute(f"UPDATE messages SET {column} = {value} WHERE id = 10")
    database.commit()
    database.close()
    check(path, samples=COUNT - 1)
    with open_recording(path) as recording:
        for _ in recording.messages():
            pass
        (warning,) = recording.warnings()
        assert "damaged at row 10 of the table messages" in warning


#: Of one link, in some ten pages.
LONG_LOG = [(10.0 + i / 10, "/tf", [("odom", "base", 20.0 + i, 2.0 * i)]) for i in range(300)]


@pytest.mark.parametrize("message", [None, 0, 150])
def test_a_damaged_page_of_a_database(tmp_path: Path, message: int | None) -> None:
    """A page of the index of the times (None) costs no message, and one of messages only its own:
    a page has about twenty."""
    path = next(write(tmp_path / "log", LONG_LOG, kind="db3").glob("*.db3"))
    data = bytearray(path.read_bytes())
    page_bytes = int.from_bytes(data[16:18], "big")
    if message is None:
        with closing(sqlite3.connect(path)) as database:
            roots = "SELECT rootpage FROM sqlite_master WHERE type = 'index' AND name LIKE '%time%'"
            ((root,),) = database.execute(roots)
        page = root - 1
    else:
        page = data.index(struct.pack("<d", 2.0 * message or 1.0)) // page_bytes
    data[page * page_bytes : (page + 1) * page_bytes] = b"\xff" * page_bytes
    path.write_bytes(data)
    with open_recording(path) as recording:
        found = [int(stamp) // S for each in recording.messages() for stamp in each.rows.stamp]
        (warning,) = recording.warnings()
    assert len(set(found)) == len(found)
    assert len(found) >= (300 if message is None else 250)
    assert 319 in found
    if message is not None:
        # The last before the page is kept; how many the page has is not known to SQLite.
        first = data.index(b"\xff" * page_bytes)
        kept = {int(i) for i in range(300) if struct.pack("<d", 2.0 * i) in data[:first]}
        assert {20 + i for i in kept if i} <= set(found)
    assert "damaged at" in warning and "such places" not in warning


def test_a_database_that_lost_some_bytes(tmp_path: Path) -> None:
    """Then pages have any numbers, also such that lead back: each row is read about once."""
    path = next(write(tmp_path / "log", LONG_LOG, kind="db3").glob("*.db3"))
    data = path.read_bytes()
    for at in range(len(data) // 2, len(data), 211):
        path.write_bytes(data[:at] + data[at + 21 :])
        with open_recording(path) as recording:
            found = list(islice(recording.messages(), 1000))
        assert 0 < len(found) < 400, at


def test_a_bag_whose_index_names_another_topic(tmp_path: Path) -> None:
    """The index of a chunk has lost a topic: its number is damaged, and the rest of it is not."""
    path = write(tmp_path / "log.bag", LOG, kind="bag")
    data = bytearray(path.read_bytes())
    at = data.rindex(b"conn=\x01\0\0\0\n\0\0\0count=")
    data[at + len("conn=")] = 77
    path.write_bytes(data)
    check(path)
    with open_recording(path) as recording:
        (warning,) = recording.warnings()
        assert "damaged at its end: the index cannot be read" in warning


@pytest.mark.parametrize(("place", "lost"), [("index", 0), ("message", 1)])
def test_a_bag_with_one_damaged_number(tmp_path: Path, place: str, lost: int) -> None:
    """The place of one message in the index of a chunk, and the topic in one message's header."""
    path = write(tmp_path / "log.bag", LOG, kind="bag")
    data = bytearray(path.read_bytes())
    topic = b"conn=\x01\0\0\0"
    if place == "index":
        entries = data.rindex(topic + b"\n\0\0\0count=") + len(topic) + 10 + 4 + 4
        data[entries + 12 * 5 + 8] ^= 0x10
    else:
        messages = [at for at in range(len(data)) if data.startswith(topic, at)]
        data[messages[10] + len("conn=")] = 77
    path.write_bytes(data)
    check(path, samples=COUNT - lost)
    with open_recording(path) as recording:
        found = [int(stamp) for each in recording.messages() for stamp in each.rows.stamp]
        (warning,) = recording.warnings()
    assert len(found) == len(set(found)) == COUNT - lost + 1
    assert "a record cannot be read" in warning


def test_no_message_is_left_after_damage(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(500))
    with pytest.raises(RecordingError, match=r"no message of type .*damaged at byte 8: no record"):
        TransformTree.from_recording(path)
