"""What snapshots and interests need of the stream that continues them."""

from __future__ import annotations

from typing import Protocol

from zenoh_tf import wire
from zenoh_tf._core import InterestReader


class CommitStream(Protocol):
    """The stream of a tree's changes. Thread safety: all methods."""

    def wait_until_active(self, timeout_s: float) -> None:
        """Wait until the changes are published, if someone listens."""

    def position(self) -> tuple[int, int]:
        """The number of a commit, and a time of the server's clock: a read of the tree from now on
        sees that commit and all before it, and all that was committed before that time."""

    def read(
        self, reader: InterestReader, with_all: bool, max_frames: int
    ) -> tuple[tuple[int, bool, bytes | None, bytes | None], int]:
        """Read an interest: what `InterestReader.read` returns, and a time of the server's clock:
        all that was committed before it is in what was read."""

    def last_seq(self) -> int:
        """The number of a commit: what was read of the tree until now is of no later one."""

    def missed(self, first: int) -> wire.Message:
        """The fields of the reply to `missed`: the messages from the number `first` on."""

    def real_ahead_ns(self) -> int | None:
        """By how much the server's real-time clock is ahead of its other; None if that is not
        known."""
