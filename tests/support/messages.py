"""Messages made as the protocol describes them and not as the SDK would, such as hostile ones."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import msgpack
import numpy as np
import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config

TREE = "main"
POSE = np.array([1, 0, 0, 0, 0, 0, 1], dtype="<f8")
MAX_REPLY = 1 << 30


@contextmanager
def session(endpoint: str, timeout_s: float = 20.0) -> Iterator[zenoh.Session]:
    config = zenoh_config.client([endpoint], timeout_s, max_message_bytes=MAX_REPLY)
    with zenoh.open(config) as opened:
        yield opened


Body = bytes | dict[str, Any]


def send(
    opened: zenoh.Session, request_type: str, body: Body, timeout_s: float = 120.0
) -> tuple[bytes, bool]:
    """The reply's bytes, and whether it is an error. No bytes if the query had no reply."""
    replies = opened.get(
        keys.request(TREE, request_type),
        payload=body if isinstance(body, bytes) else pack(body),
        attachment=str(opened.zid()).encode(),
        timeout=timeout_s,
        consolidation=zenoh.ConsolidationMode.NONE,
    )
    for reply in replies:
        if reply.ok is not None:
            return reply.ok.payload.to_bytes(), False
        assert reply.err is not None
        return reply.err.payload.to_bytes(), True
    return b"", True


def value(opened: zenoh.Session, request_type: str, what: str, **arguments: object) -> Any:
    """The answer to a request such as `stats`; none if it fails."""
    reply, failed = send(opened, request_type, {"v": 1, "what": what, **arguments})
    return None if failed else wire.unpack(reply)["value"]


def stats(opened: zenoh.Session) -> dict[str, Any]:
    """The server's counters, as a client names them."""
    return wire.parse_stats(value(opened, "info", "stats"))


def put(opened: zenoh.Session, authority: str, body: Body) -> None:
    payload = body if isinstance(body, bytes) else pack(body)
    opened.put(keys.put(TREE, authority, static=False), payload)


def remove_frame(opened: zenoh.Session, name: str) -> None:
    send(opened, "admin", {"v": 1, "what": "remove_frame", "name": name})


def ask(opened: zenoh.Session, request_type: str, payload: bytes, timeout_s: float = 60.0) -> Any:
    """Send a query and do not read its replies."""
    return opened.get(
        keys.request(TREE, request_type),
        FifoChannel(4),
        payload=payload,
        attachment=str(opened.zid()).encode(),
        timeout=timeout_s,
        consolidation=zenoh.ConsolidationMode.NONE,
    )


def kind_of(reply: bytes, failed: bool) -> str:
    """ "ok", the class of the error in a reply, or "none"."""
    if not failed:
        return "ok"
    if not reply:
        return "none"
    try:
        return type(wire.decode_error(wire.unpack(reply, MAX_REPLY)["error"])).__name__
    except Exception:
        return reply[:20].decode("ascii", "replace")


def pack(body: dict[str, Any]) -> bytes:
    data: bytes = msgpack.packb(body)
    return data


def lookup(
    names: Sequence[str], target: Any, source: Any, op: int = 2, stamp_ns: int = 0, **options: Any
) -> dict[str, Any]:
    """A lookup; `target` and `source` are indexes into names, one for each row."""
    rows = len(target)
    return {
        "v": 1,
        "names": list(names),
        "op": bytes([op]) * rows,
        "target": np.asarray(target, "<u4").tobytes(),
        "source": np.asarray(source, "<u4").tobytes(),
        "stamp": np.full(rows, stamp_ns, "<i8").tobytes(),
        **options,
    }


def same_lookup(rows: int, target: str, source: str, **options: Any) -> dict[str, Any]:
    """The same lookup in each row."""
    return lookup([target, source], np.zeros(rows), np.ones(rows), **options)


def commit(
    names: Sequence[str], parent: Any, child: Any, stamp: Any = 1, **options: Any
) -> dict[str, Any]:
    """A commit; `parent` and `child` are indexes into names, one for each row."""
    rows = len(parent)
    return {
        "v": 1,
        "names": list(names),
        "parent": np.asarray(parent, "<u4").tobytes(),
        "child": np.asarray(child, "<u4").tobytes(),
        "stamp": np.broadcast_to(np.asarray(stamp, "<i8"), rows).tobytes(),
        "pose": np.tile(POSE, rows).tobytes(),
        **options,
    }


def chain(prefix: str, links: int, root: str = "root", **options: Any) -> dict[str, Any]:
    """A commit of a chain of new frames below `root`."""
    names = [root, *(f"{prefix}{index}" for index in range(links))]
    return commit(names, np.arange(links), np.arange(1, links + 1), **options)


def star(
    prefix: str, first: int, frames: int, root: str = "root", **options: Any
) -> dict[str, Any]:
    """A commit of new frames below one root."""
    names = [root, *(f"{prefix}{index}" for index in range(first, first + frames))]
    return commit(names, np.zeros(frames), np.arange(1, frames + 1), **options)


def write_fields(opened: zenoh.Session) -> dict[str, Any]:
    """Id, expiry and instance, which make a write remembered."""
    hello = value(opened, "hello", "hello")
    offset_ns = hello["clock_ns"] - time.monotonic_ns()
    expires_ns = time.monotonic_ns() + offset_ns + 590_000_000_000
    return {"id": os.urandom(16), "expires_ns": expires_ns, "instance": hello["instance"]}
