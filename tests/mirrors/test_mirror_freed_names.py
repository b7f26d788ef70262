"""Mirrors that are made while names lose their ids, at the limit of frames, are exact."""

from __future__ import annotations

import threading
from collections.abc import Callable
from itertools import pairwise

import pytest

from tests.conftest import StartServer
from tests.support.logged_trees import Mirror, make_tree, state
from tests.support.small_robot import link
from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeLog
from zenoh_tf.wire.stream import ORPHANED
from zenoh_tf_client import TransformClient
from zenoh_tf_client.mirror.source import MirrorSource

SECOND = 1_000_000_000


class HalfRead:
    """A tree of 16 frames whose ids are nearly used up, and a mirror that has read one frame of it:
    "F", which has samples of several parents."""

    def __init__(self, *parents: str, visitors: int) -> None:
        self.tree = TransformTree(1.0, max_frames=16, max_log_bytes=1 << 20)
        self.log = ChangeLog(self.tree)
        self.position = self.log.start()
        for stamp, parent in enumerate(parents):
            self.set(parent, "F", 10 + stamp)
        self.set("F", "Z", 10)
        for i in range(visitors):
            self.set("Z", f"visitor{i}", 10)
            self.tree.remove_frame(f"visitor{i}")

    def set(self, parent: str, child: str, stamp_ns: int = 10) -> None:
        self.tree.set_transform(link(parent, child, stamp_ns))

    def begin(self) -> None:
        self.mirror = Mirror()
        self.seq, ever_reparented, bounds = self.log.plan_snapshot(1)
        assert ever_reparented
        self.mirror.replay.set_ever_reparented()
        self.pieces = list(pairwise(int(bound) for bound in bounds))
        assert self._load(*self.pieces.pop(0)) == "F"

    def load_the_rest(self) -> None:
        for after, last in self.pieces:
            self._load(after, last)

    def _load(self, after: int, last: int) -> str:
        _, frames = self.log.read_snapshot(after, last, 1 << 20)
        self.mirror.replay.load(frames)
        return frames.names[0] if frames.names else ""

    def check(self) -> None:
        position = 0
        orphaned = 0
        while position < self.log.last:
            _, position, lost, changes = self.log.take(1)
            assert not lost
            if position > self.seq and changes is not None:
                orphaned += int((changes.kind == ORPHANED).sum())
                self.mirror.replay.apply(position, changes)
        assert orphaned > 0
        assert state(self.mirror.tree) == state(self.tree)
        assert sorted(self.mirror.tree.frames()) == sorted(self.tree.frames())


def test_a_lost_parent_that_is_back_when_the_rest_is_read() -> None:
    tree = HalfRead("P", "R", visitors=13)
    tree.begin()
    tree.tree.remove_frame("P")
    tree.set("R", "X")  # needs an id: all removed names lose theirs, and "F" a parent
    tree.set("R", "P")
    tree.load_the_rest()
    tree.check()


def test_a_parent_that_is_removed_in_the_mirror_but_kept_its_id() -> None:
    tree = HalfRead("P", "Y", "R", visitors=12)
    tree.begin()
    tree.tree.remove_frame("P")
    tree.set("R", "X")  # "F" loses P, and keeps Y
    tree.tree.remove_frame("Y")
    tree.load_the_rest()
    tree.set("R", "Y")  # comes back with its id
    tree.check()


def test_a_parent_that_was_removed_before_the_snapshot() -> None:
    tree = HalfRead("P", "R", visitors=13)
    tree.tree.remove_frame("P")
    tree.begin()
    tree.set("R", "X")
    tree.set("R", "P")
    tree.load_the_rest()
    tree.check()


def test_several_frames_lose_several_parents_at_once() -> None:
    tree = HalfRead("P", "Y", "R", visitors=9)
    tree.set("P", "G", 10)
    tree.set("R", "G", 11)
    tree.begin()
    for name in ("P", "Y"):
        tree.tree.remove_frame(name)
    for name in ("A", "B", "C"):
        tree.set("R", name)
    tree.set("R", "P")
    tree.load_the_rest()
    tree.check()


@pytest.mark.parametrize("frees", [False, True])
def test_a_frame_that_comes_back_as_a_parent_has_the_trees_version(frees: bool) -> None:
    """The first reparenting gives every frame a new version, also those without a name."""
    tree = make_tree(max_frames=16, max_log_bytes=1 << 20)
    log = ChangeLog(tree)
    tree.set_transform(link("P", "F", 1))
    tree.set_transform(link("Q", "G", 1))
    tree.remove_frame("G")
    tree.remove_frame("Q")
    if frees:  # "Q" has lost its id, and gets another frame's
        for i in range(16):
            tree.set_transform(link("P", f"visitor{i}", 1))
            tree.remove_frame(f"visitor{i}")
    mirror = Mirror()
    position = log.start()
    mirror.load(log, 1 << 20, lambda: None)
    tree.set_transform(link("Q", "F", 2))
    _, last, _, changes = log.take(1 << 20)
    assert last == position + 1
    assert changes is not None
    mirror.replay.apply(last, changes)
    assert state(mirror.tree) == state(tree)


def test_transactions_in_a_mirror_on_a_frame_that_came_back(client: TransformClient) -> None:
    client.set_transform(link("P", "F", 1))
    client.set_transform(link("Q", "G", 1))
    client.remove_frame("G")
    client.remove_frame("Q")
    with client.mirror() as mirror:
        client.set_transform(link("Q", "F", 2))
        client.set_transform(link("Q", "H", 2))
        mirror.wait_for()
        calls = []

        def move(tx: object) -> None:
            calls.append(tx)
            tx.lookup_transform("H", "F")  # type: ignore[attr-defined]
            tx.set_transform(link("Q", "F", 3))  # type: ignore[attr-defined]

        mirror.run_transaction(move)
        assert len(calls) == 1


def test_the_mirror_of_a_server_whose_names_lose_their_ids(
    start_server: StartServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = start_server("--limit", "frames=16", "--cache-time", "1000s")
    with server.connect() as tf:

        def many(parent: str, begin_ns: int) -> None:  # about two pieces of a snapshot
            for first in range(0, 8000, 1000):
                rows = [link(parent, "F", begin_ns + i) for i in range(first, first + 1000)]
                tf.set_transforms_xact(rows)

        many("P", 10 * SECOND)
        many("R", 11 * SECOND)
        tf.set_transform(link("F", "Z", 10 * SECOND))
        for i in range(13):
            tf.set_transform(link("Z", f"visitor{i}", SECOND))
            tf.remove_frame(f"visitor{i}")
        first_piece = threading.Event()
        moved: list[int] = []
        ask: Callable[..., wire.Message] = MirrorSource.ask

        def hold_back(
            self: MirrorSource, request_type: str, body: wire.Message, wait_s: float
        ) -> wire.Message:
            request = wire.parse_snapshot_request(body) if request_type == "snapshot" else None
            if request is not None and request.after > 0 and not moved:
                assert first_piece.wait(10)
                moved.append(request.after)
                tf.remove_frame("P")
                tf.set_transform(link("R", "X", 10 * SECOND))
                tf.set_transform(link("R", "P", 10 * SECOND))
            reply = ask(self, request_type, body, wait_s)
            if request is not None and request.after == 0:
                first_piece.set()
            return reply

        monkeypatch.setattr(MirrorSource, "ask", hold_back)
        with tf.mirror() as mirror:
            mirror.wait_for()
            assert moved
            for parent in ("P", "R", "X", "Z"):
                for stamp in (10 * SECOND, 10 * SECOND + 7999, 11 * SECOND):
                    asked = (parent, "F", stamp)
                    assert answer(mirror, *asked) == answer(tf, *asked), asked


def answer(tree: object, target: str, source: str, stamp_ns: int) -> object:
    try:
        found = tree.lookup_transform(target, source, stamp_ns)  # type: ignore[attr-defined]
    except Exception as error:
        return type(error).__name__, str(error)
    return found.stamp_ns, found.transform.translation.tolist()
