"""What a server with --state-dir keeps, and what it says when it cannot."""

from __future__ import annotations

import resource
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess, refused
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import LookupException, NotDurable
from zenoh_tf_client import TransformClient

POSE = Transform((0.1, -0.0, 1e-300), (0.5, -0.5, 0.5, 0.5))


def link(parent: str, child: str, x: float = 0.0, stamp_ns: int = 0) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0)))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "state"


@pytest.fixture
def start(start_server: StartServer, folder: Path) -> Callable[..., ServerProcess]:
    """``start(*flags)``: a server on the folder."""
    endpoint = free_endpoint()
    return lambda *flags: start_server("--state-dir", str(folder), *flags, endpoint=endpoint)


def refusal(folder: Path, *flags: str) -> str:
    """The line of a server that cannot start."""
    shown = refused("--listen", free_endpoint(), "--state-dir", str(folder), *flags)
    line = shown.splitlines()[-1]
    assert line.startswith("zenoh-tf-server: "), shown
    return line


def is_known(tf: TransformClient, frame: str) -> bool:
    try:
        return tf.frame(frame).parent is not None
    except LookupException:
        return False


def test_a_link_comes_back_as_it_was(start: Callable[..., ServerProcess]) -> None:
    stamped = StampedTransform("karte \U0001f916", "base\x01link", 123, POSE)
    server = start()
    with server.connect() as tf:
        tf.set_transform(stamped, authority="calibration cell", static=True)
        before = tf.lookup_transform(stamped.parent_frame, stamped.child_frame)
    for _ in range(2):
        server.kill()
        server = start()
        with server.connect() as tf:
            info = tf.frame(stamped.child_frame)
            assert (info.static, info.authority) == (True, "calibration cell")
            assert info.newest_stamp_ns == 123
            assert tf.lookup_transform(stamped.parent_frame, stamped.child_frame) == before


def test_the_last_of_two_rows_counts(start: Callable[..., ServerProcess]) -> None:
    server = start()
    with server.connect() as tf:
        rows = [link("map", "a", 1, 5), link("map", "a", 2, 9), link("map", "a", 3, 7)]
        tf.set_transforms_xact(rows, static=True)
        before = tf.lookup_transform("map", "a")
    server.kill()
    with start().connect() as tf:
        assert tf.lookup_transform("map", "a") == before


def test_what_was_dropped_stays_away(start: Callable[..., ServerProcess]) -> None:
    server = start()
    with server.connect() as tf:
        names = ["removed", "top", "below", "dynamic", "moved", "kept"]
        parents = dict.fromkeys(names, "map") | {"below": "top"}
        tf.set_transforms_xact([link(parents[name], name) for name in names], static=True)
        tf.remove_frame("removed")
        tf.remove_frame("top", subtree=True)
        tf.set_transform(link("map", "dynamic", 1, time.time_ns()))
        tf.set_transform(link("kept", "moved"), static=True)
        tf.clear()
    server.kill()
    with start().connect() as tf:
        assert {name for name in names if is_known(tf, name)} == {"moved", "kept"}
        assert tf.parent("moved") == "kept"


@pytest.mark.parametrize("drop", [lambda tf: tf.clear(False), lambda tf: tf.reset()])
def test_all_statics_are_dropped(
    start: Callable[..., ServerProcess], drop: Callable[[TransformClient], None]
) -> None:
    server = start()
    with server.connect() as tf:
        tf.set_transforms_xact([link("map", "a"), link("map", "b")], static=True)
        drop(tf)
        tf.set_transform(link("map", "new"), static=True)
    server.kill()
    with start().connect() as tf:
        assert sorted(tf.frames()) == ["map", "new"]


def test_published_statics_are_stored_first(start: Callable[..., ServerProcess]) -> None:
    server = start()
    with server.connect() as tf:
        with tf.broadcaster("urdf") as urdf:
            urdf.send_static([link("map", "a", 1), link("map", "b", 2)])
        assert tf.can_transform("a", "b", timeout_s=10)
        tf.set_transform(link("map", "c", 3), static=True)
    server.kill()
    with start().connect() as tf:
        assert tf.frame("b").authority == "urdf"


def test_a_stop_stores_what_is_pending(start: Callable[..., ServerProcess]) -> None:
    server = start()
    with server.connect() as tf, tf.broadcaster("urdf") as urdf:
        urdf.send_static([link("map", f"frame {number}") for number in range(1000)])
        assert tf.can_transform("map", "frame 999", timeout_s=10)
    assert server.stop() == 0
    with start().connect() as tf:
        assert len(tf.frames()) == 1001


def test_two_servers_on_one_folder(start: Callable[..., ServerProcess], folder: Path) -> None:
    server = start()
    line = refusal(folder)
    assert f"another server uses --state-dir {folder} (process {server.process.pid})" in line
    server.kill()
    start().stop()


def test_a_full_disk(start: Callable[..., ServerProcess]) -> None:
    """A file that may not grow stands for a full disk; later there is space again."""
    server = start()
    no_limit = resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE)
    with server.connect() as tf:
        tf.set_transform(link("map", "first"), static=True)
        resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (64 << 10, no_limit[1]))
        with pytest.raises(NotDurable, match=r"state\.sqlite3: (disk I/O|.*disk is full)"):
            for number in range(100):
                tf.set_transform(link("map", f"frame {number}"), static=True)
        # The write was applied, and the server continues.
        count = len(tf.frames())
        assert tf.can_transform("map", tf.frames()[-1])
        assert tf.set_transform(link("map", "dynamic", 1, 5))
        assert tf.stats()["state_pending"] > 0
        server.wait_for_log("cannot store the state")
        assert server.log.count("cannot store the state") == 1
        with pytest.raises(NotDurable):
            tf.remove_frame("first")
        with tf.batch() as batch:
            handle = batch.set_transform(link("map", "batched"), static=True)
            batch.frames()
        with pytest.raises(NotDurable):
            handle.result()

        resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, no_limit)
        tf.set_transform(link("map", "last"), static=True)
        assert tf.stats()["state_pending"] == 0
        server.wait_for_log("is stored again")
    server.kill()
    with start().connect() as tf:
        frames = tf.frames()
        assert len(frames) == count + 1  # without "first" and "dynamic"
        assert not {"first", "dynamic"} & set(frames)


def written(start: Callable[..., ServerProcess]) -> None:
    server = start()
    with server.connect() as tf:
        tf.set_transforms_xact([link("map", f"frame {n}", n) for n in range(50)], static=True)
    assert server.stop() == 0


def flip(path: Path) -> None:
    """Change a stored pose."""
    with sqlite3.connect(path) as database:
        database.execute(
            "UPDATE entries SET value = (SELECT value FROM entries WHERE name = 'frame 7') "
            "WHERE name = 'frame 6'"
        )
    database.close()


def change_schema_version(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA user_version = 7")
    database.close()


def link_to_nowhere(path: Path) -> None:
    path.unlink()
    path.symlink_to("/nowhere/state.sqlite3")


DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "garbage": (lambda path: path.write_bytes(b"garbage" * 1000), "file is not a database"),
    "empty": (lambda path: path.write_bytes(b""), "it is not a state of zenoh-tf-server"),
    "cut off": (lambda path: path.write_bytes(path.read_bytes()[:5000]), "is damaged"),
    "a page of zeros": (
        lambda path: path.write_bytes(path.read_bytes()[:4096] + bytes(8192)),
        "is damaged",
    ),
    "another value": (flip, "the row of 'frame 6' in static_links has a wrong checksum"),
    "a link to a disk that is not mounted": (
        link_to_nowhere,
        "it is a link to /nowhere/state.sqlite3, which is missing",
    ),
    "missing, but its log is there": (
        lambda path: path.rename(path.with_name("state.sqlite3-wal")),
        "the file is missing",
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file(start: Callable[..., ServerProcess], folder: Path, damage: str) -> None:
    written(start)
    change, reason = DAMAGES[damage]
    path = folder / "state.sqlite3"
    change(path)
    line = refusal(folder)
    assert f"the state {path} is damaged: " in line
    assert reason in line
    assert line.endswith(
        f"put back a copy of {folder}, or move it away to start without the links that were stored"
    )


def test_a_file_of_another_version_or_tree(
    start: Callable[..., ServerProcess], folder: Path
) -> None:
    written(start)
    line = refusal(folder, "--tree", "other")
    assert "belongs to tree 'main', not to 'other'" in line
    change_schema_version(folder / "state.sqlite3")
    assert "has version 7, and this server knows version 4" in refusal(folder)


def test_a_file_that_another_program_uses(
    start: Callable[..., ServerProcess], folder: Path
) -> None:
    written(start)
    path = folder / "state.sqlite3"
    other = sqlite3.connect(path, isolation_level=None)
    try:
        other.execute("PRAGMA locking_mode = EXCLUSIVE")
        other.execute("BEGIN IMMEDIATE")
        assert f"cannot open the state {path}: database is locked" in refusal(folder)
    finally:
        other.close()
    start()


def test_links_that_do_not_fit(start: Callable[..., ServerProcess], folder: Path) -> None:
    written(start)
    line = refusal(folder, "--limit", "frames=10")
    assert f"the static links of {folder / 'state.sqlite3'} do not fit into the tree: " in line
    assert "the limit of 10 frames is reached" in line


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "cannot use --state-dir" in refusal(tmp_path / "file" / "state")
