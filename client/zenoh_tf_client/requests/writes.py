"""Makes the requests of writes. Each function serves the client method of the same name."""

from __future__ import annotations

from collections.abc import Sequence

from zenoh_tf import StampedTransform, wire

from . import columns
from .request import Call, Request


def set_transform(
    stamped: StampedTransform, authority: str = "", static: bool = False
) -> Request[bool]:
    commit = columns.commit([stamped], authority, static)
    commit.drop_old = True
    return Call(
        "commit",
        wire.commit_body(commit),
        lambda reply: wire.parse_commit_reply(reply, 1) != b"\0",
        # Access rules allow a message to write as one authority only.
        group=f"commit as {authority}",
    )


def set_transforms_xact(
    stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
) -> Request[None]:
    return commit(columns.commit(stampeds, authority, static))


def commit(commit: wire.Commit, instance: str | None = None) -> Request[None]:
    """A commit of all rows or none; only server `instance` may apply it, if one is given."""

    def parse(reply: wire.Message) -> None:
        wire.parse_commit_reply(reply, len(commit.rows))

    return Call("commit", wire.commit_body(commit), parse, instance=instance)


def _admin(what: str, **arguments: str | bool) -> Request[None]:
    body = wire.call_body(what, **arguments)
    return Call("admin", body, lambda reply: wire.parse_value(reply, type(None)))


def clear(keep_static: bool = True) -> Request[None]:
    return _admin("clear", keep_static=keep_static)


def reset() -> Request[None]:
    return _admin("reset")


def remove_frame(name: str, subtree: bool = False) -> Request[None]:
    return _admin("remove_frame", name=name, subtree=subtree)
