"""Raw Zenoh messages that the SDK would never send."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from zenoh_tf import keys, wire


def config(endpoint: str, mode: str = "client") -> zenoh.Config:
    settings: dict[str, Any] = {
        "mode": mode,
        "connect/endpoints" if mode == "client" else "listen/endpoints": [endpoint],
        "connect/timeout_ms": 5000,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    made = zenoh.Config()
    for key, value in settings.items():
        made.insert_json5(key, json.dumps(value))
    return made


class Raw:
    def __init__(self, session: zenoh.Session, tree: str = "main") -> None:
        self.session = session
        self.tree = tree

    def query(self, operation: str, payload: bytes | None, timeout_s: float = 5.0) -> wire.Message:
        """The reply's map, which may hold an error; AssertionError for no reply."""
        key = keys.operation(self.tree, operation)
        replies = list(self.session.get(key, payload=payload, timeout=timeout_s))
        assert len(replies) == 1, f"{len(replies)} replies"
        answer = replies[0].ok or replies[0].err
        assert answer is not None
        return wire.unpack(answer.payload.to_bytes())

    def error(self, operation: str, payload: bytes | None) -> Exception:
        reply = self.query(operation, payload)
        return wire.parse_fault(reply["error"])

    def put(self, authority: str, payload: bytes, *, static: bool = False) -> None:
        self.session.put(keys.put(self.tree, authority, static=static), payload)


@contextmanager
def raw(endpoint: str, tree: str = "main") -> Iterator[Raw]:
    with zenoh.open(config(endpoint)) as session:
        yield Raw(session, tree)
