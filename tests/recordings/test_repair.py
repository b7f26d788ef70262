"""``zenoh-tf record --repair``: cut-off and damaged MCAP files, and what is said to be lost."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from tests.support.command_line import Done, call
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings import open_recording
from zenoh_tf.recordings.repair import repair
from zenoh_tf.recordings.writer import RecordingWriter

from .readers import read_with_rosbags

CHUNKS = 12
PER_CHUNK = 5


def rows(*stampeds: StampedTransform) -> TransformRows:
    return TransformRows.of_tuples(
        [(s.parent_frame, s.child_frame, s.stamp_ns, tuple(s.transform.pose())) for s in stampeds]
    )


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """As `record` writes it: a static link, then chunks of five messages, flushed one by one."""
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, "ros2", {"tree": "main"})
    writer.write(0, True, rows(StampedTransform("base", "camera", 0, Transform((1, 0, 0)))))
    for i in range(CHUNKS * PER_CHUNK):
        at = StampedTransform("map", "base", i * 10**9, Transform((i, 0, 0)))
        writer.write(i * 10**9, False, rows(at))
        if (i + 1) % PER_CHUNK == 0:
            writer.flush()
    writer.close()
    return path


def spoil(path: Path, name: str, *, end: int | None = None, flip: int | None = None) -> Path:
    """A copy without what comes after `end`, or with another byte at `flip`."""
    data = bytearray(path.read_bytes()[:end])
    if flip is not None:
        data[flip] ^= 0xFF
    spoilt = path.with_name(name)
    spoilt.write_bytes(data)
    return spoilt


def chunk_ends(path: Path) -> list[int]:
    """Where the chunks of a complete file end."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return [chunk.chunk_start_offset + chunk.chunk_length for chunk in summary.chunk_indexes]


def test_cut_off_anywhere(recorded: Path) -> None:
    """The new file has every message of each complete chunk, and is complete for all libraries.

    The chunks are too small for a part of one to be read."""
    ends = chunk_ends(recorded)
    assert len(ends) == CHUNKS
    size = recorded.stat().st_size
    for number, end in enumerate(np.linspace(ends[0], size - 1, 40).astype(int).tolist()):
        cut = spoil(recorded, f"cut{number}.mcap", end=end)
        out = recorded.with_name(f"fixed{number}.mcap")
        found = repair(cut, out)
        complete = sum(each <= end for each in ends)
        assert found.messages == 1 + complete * PER_CHUNK  # the first one has the static link
        assert found.lost_messages == 0
        if found.lost_from_ns is not None:
            assert found.lost_from_ns == complete * PER_CHUNK * 10**9
            assert found.lost_to_ns == ((complete + 1) * PER_CHUNK - 1) * 10**9
        with open_recording(out) as recording:
            assert not recording.is_cut_off
            assert recording.message_count == found.messages
        assert len(read_with_rosbags(out)) == found.messages
        tree = TransformTree.from_recording(out)
        assert tree.frame("camera").static
        assert tree.frame("base").newest_stamp_ns == (complete * PER_CHUNK - 1) * 10**9


@pytest.mark.parametrize("compression", CompressionType, ids=lambda each: each.name)
def test_the_messages_of_a_part_of_a_chunk(tmp_path: Path, compression: CompressionType) -> None:
    path, out = tmp_path / "run.mcap", tmp_path / "fixed.mcap"
    writer = Writer(str(path), chunk_size=1 << 24, compression=compression)
    writer.start()
    channel = writer.register_channel("/raw", "bytes", 0)
    random = np.random.default_rng(3)
    for i in range(3000):
        writer.add_message(channel, i, random.bytes(500), i)
    writer.finish()
    cut = spoil(path, "cut.mcap", end=path.stat().st_size // 2)
    found = repair(cut, out)
    assert 1000 < found.messages < 2000
    assert (found.lost_from_ns, found.lost_to_ns) == (found.messages - 1, 2999)
    assert found.lost_bytes // (3000 - found.messages) == 531  # with its head of 31
    with out.open("rb") as file:
        read = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert read == list(range(found.messages))


def test_a_damaged_chunk_is_left_out_and_counted(recorded: Path) -> None:
    ends = chunk_ends(recorded)
    damaged = spoil(recorded, "damaged.mcap", flip=ends[3] - 10)
    out = recorded.with_name("fixed.mcap")
    found = repair(damaged, out)
    assert (found.lost_chunks, found.lost_messages) == (1, PER_CHUNK)
    assert found.messages == 1 + (CHUNKS - 1) * PER_CHUNK
    stamps = [row[2] for _, message in read_with_rosbags(out) for row in message]
    assert {n * 10**9 for n in range(15, 20)}.isdisjoint(stamps)


def test_everything_else_is_kept(tmp_path: Path) -> None:
    """Other topics, outside of chunks, too; attachments, and numbers of channels that differ."""
    path, out = tmp_path / "other.mcap", tmp_path / "fixed.mcap"
    writer = Writer(str(path), use_chunking=False)
    writer.start(profile="mine", library="ours")
    writer.register_schema("unused", "jsonschema", b"{}")
    schema = writer.register_schema("Note", "jsonschema", b'{"type": "object"}')
    without = writer.register_channel("/raw", "bytes", 0)
    notes = writer.register_channel("/notes", "json", schema, {"who": "me"})
    writer.add_attachment(1, 2, "map.png", "image/png", b"picture")
    writer.add_metadata("run", {"place": "hall"})
    writer.add_message(notes, 5, b"{}", 6, 7)
    writer.add_message(without, 8, b"\0", 9)
    writer.finish()
    spoil(path, "cut.mcap", end=path.stat().st_size - 8)
    assert repair(tmp_path / "cut.mcap", out).messages == 2
    with out.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert (reader.get_header().profile, reader.get_header().library) == ("mine", "ours")
        found = list(reader.iter_messages())
        (attachment,) = reader.iter_attachments()
        assert (attachment.name, attachment.data) == ("map.png", b"picture")
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata == {"place": "hall"}
    (note_schema, note_channel, note), (no_schema, _, raw) = found
    assert note_schema is not None and note_schema.name == "Note"
    assert no_schema is None
    assert (note_channel.topic, note_channel.metadata) == ("/notes", {"who": "me"})
    assert (note.log_time, note.publish_time, note.sequence, note.data) == (5, 6, 7, b"{}")
    assert raw.data == b"\0"


def test_any_damage_ends_well(recorded: Path) -> None:
    """A wrong byte anywhere: the new file is readable, or an error says why there is none."""
    size = recorded.stat().st_size
    random = np.random.default_rng(7)
    for number, flip in enumerate(random.integers(8, size, 60).tolist()):
        damaged = spoil(recorded, f"damaged{number}.mcap", flip=flip)
        out = recorded.with_name(f"fixed{number}.mcap")
        try:
            repair(damaged, out)
        except Exception as error:
            assert type(error).__name__ == "RecordingError"
            assert not out.exists()
        else:
            with out.open("rb") as file:
                list(make_reader(file, validate_crcs=True).iter_messages())


def test_what_it_prints(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ends = chunk_ends(recorded)
    cut = spoil(recorded, "cut.mcap", end=ends[4] - 1)
    fixed, again = (str(cut.with_name(name)) for name in ("fixed.mcap", "again.mcap"))
    done = call(capsys, "record", fixed, "--repair", str(cut))
    assert (done.returncode, done.stderr) == (0, "")
    first, second, third = done.stdout.splitlines()
    assert first.startswith(f"21 messages of {cut} written to {fixed} (")
    assert second == (
        "the last chunk is not complete: messages from 20.000000000 s to 24.000000000 s are lost"
    )
    assert re.fullmatch(r"lost: [\d,]+ bytes, 1 chunks", third)
    document = json.loads(call(capsys, "record", again, "--repair", str(cut), "--json").stdout)
    assert (document["messages"], document["lost_from_ns"]) == (21, 20 * 10**9)


def test_what_cannot_be_repaired(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = recorded.with_name("fixed.mcap")
    text = recorded.with_name("notes.txt")
    text.write_text("no recording")
    begin = spoil(recorded, "begin.mcap", end=60)

    def refused(done: Done) -> str:
        assert (done.returncode, done.stdout) == (1, "")
        assert not out.exists()
        return done.stderr

    def repaired(file: Any, new: Any = out) -> Done:
        return call(capsys, "record", str(new), "--repair", str(file))

    assert "not an MCAP file; only those can be repaired" in refused(repaired(text))
    assert "it has no complete message" in refused(repaired(begin))
    assert "the file is complete, so there is nothing to repair" in refused(repaired(recorded))
    assert "No such file or directory" in refused(repaired(recorded.with_name("nowhere.mcap")))
    assert "Is a directory" in refused(repaired(recorded.parent))
    assert f"{begin}: the file exists" in refused(repaired(recorded, begin))
    assert "No such file or directory" in refused(repaired(begin, "/nowhere/fixed.mcap"))
