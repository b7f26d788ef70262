"""Makes the requests of writes. Each function serves the client method of the same name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from zenoh_tf import StampedTransform, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import must_be

from . import columns
from .request import Call, Request


@dataclass(slots=True)
class SetTransform(Request[bool]):
    """A commit of one transform, which may be dropped as too old."""

    message: wire.Message
    request_type: str = "commit"
    wait_s: float = 0.0
    writes: bool = True

    @property
    def group(self) -> str:
        # Access rules allow a message to write as one authority only.
        return f"commit as {self.message.get('authority', '')}"

    def body(self) -> wire.Message:
        return self.message

    def parse(self, reply: wire.Message) -> bool:
        return wire.parse_commit_reply(reply, 1) != b"\0"


def set_transform(
    stamped: StampedTransform, authority: str = "", static: bool = False
) -> Request[bool]:
    if not isinstance(stamped, StampedTransform):
        raise must_be("stamped", "a StampedTransform", stamped)
    rows = TransformRows.of((stamped,))
    return SetTransform(wire.commit_body(wire.Commit(rows, authority, static, drop_old=True)))


def set_transforms_xact(
    stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
) -> Request[None]:
    return commit(columns.commit(stampeds, authority, static))


def commit(commit: wire.Commit, instance: str | None = None) -> Request[None]:
    """A commit of all rows or none; only server `instance` may apply it, if one is given."""

    def parse(reply: wire.Message) -> None:
        wire.parse_commit_reply(reply, len(commit.rows))

    return Call("commit", wire.commit_body(commit), parse, instance=instance, writes=True)


def _admin(what: str, **arguments: str | bool) -> Request[None]:
    body = wire.call_body(what, **arguments)
    return Call("admin", body, lambda reply: wire.parse_value(reply, type(None)), writes=True)


def clear(keep_static: bool = True) -> Request[None]:
    return _admin("clear", keep_static=keep_static)


def reset() -> Request[None]:
    return _admin("reset")


def remove_frame(name: str, subtree: bool = False) -> Request[None]:
    return _admin("remove_frame", name=columns.name(name, "name"), subtree=subtree)
