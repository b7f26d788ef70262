"""One copy of a server's tree: made from a snapshot's pieces, then kept by the stream's messages.

Thread safety: none; the owner locks.

Internal: for `zenoh_tf.mirrors.mirroring`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from itertools import pairwise
from typing import Protocol

from .. import wire
from .._core import ChangeReplay
from ..tree import TransformTree


class Observer(Protocol):
    """Receives all that copies are made of, in order; `recorder.py` records it. Must not wait."""

    def begin(self, instance: str, seq: int) -> None:
        """A copy begins: of a server's instance, as it was after the commit `seq` or later."""

    def load(self, frames: bytes) -> None:
        """Some frames of a snapshot, with their histories."""

    def apply(self, message: wire.StreamMessage) -> None:
        """Changes, after all frames of the snapshot. Some may be in the snapshot already. All that
        there is of an interest comes as changes that end with the commit `seq`."""


class Copy:
    """One copy of the tree, from its snapshot on."""

    def __init__(
        self,
        instance: str,
        plan: wire.SnapshotPlan,
        tree: TransformTree,
        observer: Observer | None,
        replay: ChangeReplay | None,
    ) -> None:
        """`replay`: into the tree; None: what comes goes to the observer alone."""
        self.observer = observer
        if observer is not None:
            observer.begin(instance, plan.seq)
        self.instance = instance
        self.tree = tree
        self.replay = replay
        if plan.ever_reparented and replay is not None:
            replay.set_ever_reparented()
        self.overtaken_until = plan.seq  # a snapshot may overtake messages of up to this number
        #: The number of the last commit that `tree` has, and of the last that it may have already.
        self.seq = self.reach_seq = plan.seq
        #: Of the last reply with missed messages: the hash of each by its last number.
        self.repeats: dict[int, int] = {}
        self.complete_at_seq = plan.seq
        self.clock_ns = plan.clock_ns
        bounds = [int(bound) for bound in plan.bounds]
        self.pieces = deque(
            wire.SnapshotRequest(instance, number, after, until)
            for number, (after, until) in enumerate(pairwise(bounds))
        )
        self.loading = len(self.pieces)  # pieces that are not loaded yet
        if plan.changes is not None:
            self._add(wire.StreamMessage(instance, plan.seq, plan.seq, plan.clock_ns, plan.changes))

    @property
    def is_complete(self) -> bool:
        return not self.loading and self.seq >= self.complete_at_seq

    def load(self, piece: wire.SnapshotRequest, loaded: wire.SnapshotPiece) -> None:
        """Add a piece's frames; ask for its rest if it was cut short."""
        if self.replay is not None:
            self.replay.load(loaded.frames)
        if self.observer is not None:
            self.observer.load(loaded.frames)
        self.complete_at_seq = max(self.complete_at_seq, loaded.last)
        if loaded.reached < piece.until:
            self.pieces.append(replace(piece, after=max(loaded.reached, piece.after)))
        else:
            self.loading -= 1

    def apply(self, message: wire.StreamMessage) -> None:
        """Apply a message that begins at most one after the last one."""
        if message.changes is not None and message.last > self.seq:
            self.reach_seq = max(self.reach_seq, message.last)
            self._add(message)
        self.seq = self.reach_seq = max(self.seq, message.last)
        self.clock_ns = max(self.clock_ns, message.clock_ns)

    def _add(self, message: wire.StreamMessage) -> None:
        assert message.changes is not None
        if self.replay is not None:
            self.replay.apply(message.last, message.changes)
        if self.observer is not None:
            self.observer.apply(message)

    def contradicts(self, message: wire.StreamMessage, data: bytes) -> bool:
        """Whether a message cannot be of the server that the copy is of, if all others are: it
        comes twice only if a reply with missed messages overtakes it, and then the same bytes."""
        if not self.overtaken_until < message.first <= self.seq:  # else it may have been overtaken
            return False
        if message.last < message.first:  # a heartbeat
            return not self.repeats
        return self.repeats.get(message.last) != hash(data)
