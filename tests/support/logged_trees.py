"""Trees with a change log, random writes, and mirrors that replay them."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import ChangeLog, ChangeReplay, Frames, InterestReader, TransformRows
from zenoh_tf.errors import TransformException

CACHE_S = 1e-7  # 100 ns: histories are pruned soon
LOG_BYTES = 64 << 20
#: More frames than any test has.
MANY = 1 << 20
FRAMES = [f"f{i}" for i in range(12)]
#: A tree of so few frees ids all the time, if VISITORS come and go beside FRAMES.
FEW_FRAMES = 14
VISITORS = [f"v{i}" for i in range(16)]
#: What a frame is: version, static, authority, and its samples (stamp, parent, pose).
State = dict[str, tuple[int, bool, str, list[tuple[int, str | None, tuple[float, ...]]]]]


def make_tree(*, max_frames: int = 64, **options: Any) -> TransformTree:
    """A tree of few and short histories, so that all limits are reached."""
    return TransformTree(
        CACHE_S, max_frames=max_frames, max_samples_per_frame=16, time_jump="clear", **options
    )


def logged(
    concurrency: str = "optimistic", max_frames: int = 64
) -> tuple[TransformTree, ChangeLog]:
    """A tree and its log, which is not started."""
    tree = make_tree(concurrency=concurrency, max_frames=max_frames, max_log_bytes=LOG_BYTES)
    return tree, ChangeLog(tree)


def state(tree: TransformTree) -> State:
    """Everything that a mirror must have, read by way of a snapshot."""
    found: State = {}
    reached, message = ChangeLog(tree).read_snapshot(0, 1 << 30, 1 << 40)
    assert reached == 1 << 30
    frames = Frames(message)
    names, authorities = frames.names, frames.authorities
    frame, version, static = frames.frame, frames.version, frames.static
    authority, count = frames.authority, frames.count
    stamp, parent, pose = frames.stamp, frames.parent, frames.pose
    first = 0
    for row, index in enumerate(frame):
        samples = [
            (
                int(stamp[i]),
                names[parent[i]] if parent[i] < len(names) else None,
                tuple(pose[i].tolist()),
            )
            for i in range(first, first + int(count[row]))
        ]
        first += int(count[row])
        by = authorities[authority[row]] if samples else ""
        found[names[index]] = (int(version[row]), bool(static[row]), by, samples)
    return found


class Mirror:
    """A tree into which another is replayed. It has a log of its own, so that `state` can read
    it."""

    def __init__(self, max_frames: int = 64) -> None:
        self.tree = make_tree(max_frames=max_frames, max_log_bytes=1 << 16)
        self.replay = ChangeReplay(self.tree)

    def load(self, log: ChangeLog, piece_bytes: int, pause: Callable[[], None]) -> tuple[int, int]:
        """Load a snapshot; return its number, and the one after which the mirror is complete."""
        seq, ever_reparented, bounds = log.plan_snapshot(piece_bytes)
        if ever_reparented:
            self.replay.set_ever_reparented()
        for after, last in pairwise(bounds):
            pause()
            position = int(after)
            while position < last:
                position, frames = log.read_snapshot(position, int(last), 512)
                self.replay.load(frames)
        return seq, log.last


class Writer:
    """Random writes, each of them one of all kinds. `visits`: VISITORS come and go, so that a tree
    of FEW_FRAMES frees ids, and takes past parents from samples."""

    def __init__(self, tree: TransformTree, seed: int, *, visits: bool = False) -> None:
        self.tree = tree
        self.random = random.Random(seed)
        self.visits = visits
        self.now = 1000

    def write(self) -> None:
        """Write something, or fail to."""
        chance = self.random.random()
        try:
            if self.visits and self.random.random() < 0.2:
                self._visit()
            elif chance < 0.85:
                self._commit()
            elif chance < 0.91:
                self.tree.remove_frame(self._name(), subtree=chance < 0.88)
            elif chance < 0.95:
                self._transaction()
            elif chance < 0.98:
                self._jump()
            elif chance < 0.99:
                self.tree.clear(keep_static=self.random.random() < 0.5)
            else:
                self.tree.reset()
        except TransformException:  # a cycle, an unknown frame, no room, or a conflict
            pass

    def _name(self) -> str:
        return self.random.choice(
            VISITORS if self.visits and self.random.random() < 0.3 else FRAMES
        )

    def _stamped(self) -> StampedTransform:
        parent, child = self.random.sample(FRAMES, 2)
        if self.random.random() < 0.8:  # mostly the same tree
            child = FRAMES[1 + FRAMES.index(child) % (len(FRAMES) - 1)]
            parent = FRAMES[(FRAMES.index(child) - 1) // 2]
        if self.visits and self.random.random() < 0.3:
            visitor = self.random.choice(VISITORS)
            parent, child = (visitor, child) if self.random.random() < 0.7 else (parent, visitor)
        self.now += self.random.randrange(10)
        stamp = self.now - (self.random.randrange(60) if self.random.random() < 0.2 else 0)
        x, y, z = (self.random.uniform(-1, 1) for _ in range(3))
        rotation = (0.0, 0.0, np.sin(z), np.cos(z))
        return StampedTransform(parent, child, stamp, Transform((x, y, z), rotation))

    def _visit(self) -> None:
        """A frame moves to a visitor and back. The visitor goes, others come and go, so that ids
        are freed, and it is back."""
        visitor, *others = self.random.sample(VISITORS, self.random.randrange(2, 8))
        child = self.random.choice(FRAMES[1:])
        for parent in (visitor, FRAMES[0]):
            self._link(parent, child)
        self.tree.remove_frame(visitor, subtree=True)
        for other in others:
            self._link(FRAMES[0], other)
            self.tree.remove_frame(other, subtree=True)
        self._link(FRAMES[0], visitor)

    def write_until(self, ending: threading.Event) -> None:
        while not ending.is_set():
            self.write()

    def _link(self, parent: str, child: str) -> None:
        self.now += self.random.randrange(3)
        x = self.random.uniform(-1, 1)
        self.tree.set_transform(StampedTransform(parent, child, self.now, Transform((x, 0, 0))))

    def _commit(self) -> None:
        stampeds = [self._stamped() for _ in range(self.random.choice((1, 1, 1, 2, 5, 20)))]
        authority = self.random.choice(("", "wheels", "arm"))
        self.tree.set_transforms_xact(stampeds, authority, static=self.random.random() < 0.1)

    def _transaction(self) -> None:
        """A commit with a read set, which may be refused after it has drawn its number."""
        read = self.random.choice(FRAMES)
        stamped = self._stamped()
        self.tree._commit_rows(
            TransformRows.of([stamped]),
            read_names=[read],
            read_versions=np.array([self.random.choice((0, 4, 8))], np.uint64),
        )

    def _jump(self) -> None:
        """Two samples that are far too old: the second clears the frame's history."""
        child = self.random.choice(FRAMES[1:])
        parent = FRAMES[(FRAMES.index(child) - 1) // 2]
        for stamp in (1, 2):
            self.tree.set_transform(StampedTransform(parent, child, stamp, Transform()))


def follow(mirror: Mirror, reader: InterestReader, *, begin: bool = False) -> int:
    """Bring the mirror of an interest to the reader's state. Returns its number."""
    seq, reparented, changes, everything = reader.read(begin, MANY)
    if begin:
        assert everything is not None
        if reparented:
            mirror.replay.set_ever_reparented()
        mirror.replay.apply(seq, everything)
    elif changes is not None:
        mirror.replay.apply(seq, changes)
    return seq
