"""A reply to a read with the number of the last commit that it may have seen."""

from __future__ import annotations

from collections.abc import Callable

from zenoh_tf import wire

from .handler import ReplyCallback


class NumberedReply:
    """The ReplyCallback of a request with `with_seq`."""

    __slots__ = ("_last_seq", "_reply_to", "client")

    def __init__(self, reply_to: ReplyCallback, last_seq: Callable[[], int]) -> None:
        self.client = reply_to.client
        self._reply_to = reply_to
        self._last_seq = last_seq

    def __call__(self, reply: bytes, failed: bool) -> None:
        # Asked after the read: what it saw was committed before.
        self._reply_to(wire.with_field(reply, "seq", self._last_seq()), failed)
