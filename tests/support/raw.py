"""Raw Zenoh messages, which the SDK would never send."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config

#: A map is packed first.
Payload = bytes | wire.Message


class Raw:
    """Sends raw payloads to the server of a tree."""

    def __init__(self, session: zenoh.Session, tree: str = "main") -> None:
        self.session = session
        self.tree = tree

    def query(
        self, request_type: str, payload: Payload | None, timeout_s: float = 5.0
    ) -> wire.Message:
        """The reply's map, which may carry an error. Raises AssertionError if there is no reply."""
        key = keys.request(self.tree, request_type)
        replies = list(self.session.get(key, payload=_packed(payload), timeout=timeout_s))
        assert len(replies) == 1, f"{len(replies)} replies"
        answer = replies[0].ok or replies[0].err
        assert answer is not None
        return wire.unpack(answer.payload.to_bytes())

    def error(self, request_type: str, payload: Payload | None) -> Exception:
        return wire.decode_error(self.query(request_type, payload)["error"])

    def put(self, authority: str, payload: Payload, *, static: bool = False) -> None:
        key = keys.put(self.tree, authority, static=static)
        block = zenoh.CongestionControl.BLOCK  # a long one could be dropped
        self.session.put(key, _packed(payload), congestion_control=block)


def _packed(payload: Any) -> Any:
    return wire.pack(payload) if isinstance(payload, dict) else payload


@contextmanager
def raw(endpoint: str, tree: str = "main") -> Iterator[Raw]:
    with zenoh.open(zenoh_config.client([endpoint], 5.0)) as session:
        yield Raw(session, tree)
