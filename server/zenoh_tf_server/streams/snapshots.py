"""Answers `snapshot` and `missed` requests, with which mirrors begin and close gaps.

A mirror pulls a snapshot piece by piece, so nothing of it is kept here: a mirror that dies in the
middle costs nothing. Both have a thread and a queue of their own (`workers`), and pieces
are small: no snapshot delays other requests. Frames are read without locks, so it delays no write.

Thread safety: all methods.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeLog
from zenoh_tf.errors import ServerRestarted
from zenoh_tf.text import quoted

from .commit_stream import CommitStream
from .interests import Interests

PIECE_BYTES: Final = 1 << 20
#: A stream whose first listener has just come begins within this time.
_BEGIN_S: Final = 0.5


class Snapshots:
    """Answers from a tree and its stream."""

    def __init__(
        self,
        tree: TransformTree,
        stream: CommitStream,
        interests: Interests,
        instance: str,
        settings: wire.TreeSettings,
    ) -> None:
        """`settings`: of the tree."""
        self._tree = tree
        self._log = ChangeLog(tree)
        self._stream = stream
        self._interests = interests
        self._instance = instance
        self._settings = settings

    def _settings_now(self) -> wire.TreeSettings:
        return replace(self._settings, startup_ns=self._tree._startup_ns())

    def snapshot(self, message: wire.Message, client: str) -> wire.Message:
        """The fields of the reply to `snapshot`: the plan, or a piece, or all of an interest."""
        interest = wire.parse_interest(message)
        if interest is not None:
            return wire.snapshot_plan_reply(
                self._interests.snapshot(interest, client, self._settings_now())
            )
        request = wire.parse_snapshot_request(message)
        if request is None:
            # The mirror listens already, so it must get all that comes after the snapshot.
            self._stream.wait_until_active(_BEGIN_S)
            seq, clock_ns = self._stream.position()
            _, ever_reparented, bounds = self._log.plan_snapshot(PIECE_BYTES)
            return wire.snapshot_plan_reply(
                wire.SnapshotPlan(seq, ever_reparented, bounds, self._settings_now(), clock_ns)
            )
        self._check_instance(request.instance)
        reached, frames = self._log.read_snapshot(request.after, request.until, 2 * PIECE_BYTES)
        return wire.snapshot_piece_reply(
            wire.SnapshotPiece(request.piece, reached, self._stream.last_seq(), frames)
        )

    def missed(self, message: wire.Message, client: str) -> wire.Message:
        """The fields of the reply to `missed`."""
        instance, first, interest = wire.parse_missed_request(message)
        self._check_instance(instance)
        return self._interests.missed(interest, first) if interest else self._stream.missed(first)

    def _check_instance(self, instance: str) -> None:
        if instance != self._instance:
            raise ServerRestarted(
                f"the request is for server instance {quoted(instance)}, but this is instance "
                f"{self._instance}: load a new snapshot",
                value=quoted(instance),
            )
