"""`Receipt`: which state of the server has a write. A mirror waits for it, to read the write."""

from __future__ import annotations

from typing import NamedTuple

from zenoh_tf import wire


class Receipt(NamedTuple):
    """A state of the server that has a write, and all before it; see `Mirror.wait_for`.

    A process may hand it to another one.

    Attributes:
        instance: The server instance.
        seq: The number of a commit: of the write, or of a later one.
    """

    instance: str
    seq: int


def later(receipt: Receipt | None, reply: wire.Message) -> Receipt | None:
    """The later of a receipt and that of a reply to a write, if a reply has one."""
    seq = reply.get("seq")
    replies = reply.get("replies")
    if type(replies) is list:  # of a batch
        seqs = [entry.get("seq") for entry in (reply, *replies) if type(entry) is dict]
        seq = max((each for each in seqs if type(each) is int), default=None)
    if type(seq) is not int:
        return receipt
    if receipt is None or receipt.instance != reply.get("instance"):
        return Receipt(wire.text(reply, "instance"), seq)
    return receipt if receipt.seq >= seq else Receipt(receipt.instance, seq)
