"""`Receipt`: which state of the server has a write. A mirror waits for it, to read the write."""

from __future__ import annotations

from dataclasses import dataclass

from zenoh_tf import wire


@dataclass(frozen=True, slots=True)
class Receipt:
    """A state of the server that has a write, and all before it; see `Mirror.wait_for`.

    A process may hand it to another one.

    Args:
        instance: The server instance.
        seq: The number of a commit: of the write, or of a later one.
    """

    instance: str
    seq: int


def later(receipt: Receipt | None, reply: wire.Message) -> Receipt | None:
    """The later of a receipt and that of a reply to a write, if a reply has one."""
    replies = reply.get("replies")
    found = [reply, *replies] if type(replies) is list else [reply]
    numbers = [
        entry["seq"] for entry in found if type(entry) is dict and type(entry.get("seq")) is int
    ]
    if not numbers:
        return receipt
    told = Receipt(wire.text(reply, "instance"), max(numbers))
    if receipt is not None and receipt.instance == told.instance and receipt.seq >= told.seq:
        return receipt
    return told
