"""Real messages of every type, as the SDK and other clients send them, and how to damage them."""

from __future__ import annotations

import random
from typing import Any, NamedTuple

import msgpack

from tests.support import messages
from zenoh_tf import wire

_WRITE = {"id": bytes(16), "expires_ns": 1 << 62, "instance": "0123456789abcdef"}
_READS = {"read_names": ["a", "b"], "read_versions": bytes(16)}
_INTERESTING = (0, 1, 0x7F, 0x80, 0xC0, 0xC1, 0xD9, 0xDC, 0xDD, 0xDE, 0xDF, 0xFE, 0xFF)
_NUMBERS = (0, -1, 1, 127, 128, 255, 256, 65_535, 1 << 31, 1 << 32, (1 << 63) - 1, -(1 << 63))
_TEXTS = ("", "a", "b", "root", "x" * 300, "\n\x1b[31m\x07", "\u2028\x9b", "\x00", "é" * 128, "/*")


class Seed(NamedTuple):
    request_type: str  # a request type, or "set" or "static" for a put
    body: dict[str, Any]


def _commits() -> list[dict[str, Any]]:
    links = messages.commit(["root", "a", "b"], [0, 1], [1, 2], [5, 6])
    static = messages.chain("s", 3, static=True, authority="driver")
    return [links, {**links, **_WRITE}, {**links, **_READS, "drop_old": True}, static]


def _lookups() -> list[dict[str, Any]]:
    fixed: dict[str, Any] = {"fixed": bytes(4), "source_stamp": bytes(8)}
    return [
        messages.same_lookup(1, "root", "b"),
        messages.same_lookup(3, "root", "b", op=0, stamp_ns=5, atomic=True, versions=True),
        messages.same_lookup(1, "root", "b", op=5, **fixed),
        messages.same_lookup(2, "b", "never", op=1, errors=False),
        messages.same_lookup(1, "b", "never", op=1, timeout_ns=1_000_000),
    ]


def _infos() -> list[dict[str, Any]]:
    velocity = {
        "what": "velocity",
        "tracking_frame": "b",
        "observation_frame": "root",
        "averaging_interval_ns": 5,
        "reference_point": bytes(24),
    }
    plain: list[dict[str, Any]] = [
        {"what": what} for what in ("hello", "frames", "authorities", "stats")
    ]
    named: list[dict[str, Any]] = [
        {"what": "frame", "frame": "a"},
        {"what": "parent", "frame": "b", "stamp_ns": 5},
    ]
    ends = {"target": "root", "source": "b"}
    paths: list[dict[str, Any]] = [{"what": "chain", **ends}, {"what": "ancestors", **ends}]
    question = {"level": 0.9, "max_by_ns": 10**9, "radius_m": 0.5}
    estimates: list[dict[str, Any]] = [
        {"what": "estimate", **ends, **question, "stamp_ns": 5},
        {
            **{"what": "estimates", "names": ["root", "b"], **question},
            **{"target": bytes(4), "source": bytes([1, 0, 0, 0]), "stamp": bytes(8)},
        },
    ]
    return [*plain, *named, *paths, velocity, *estimates]


def seeds() -> list[Seed]:
    """At least one message of every request type, and every call of it."""
    infos = [{"v": 1, **each} for each in _infos()]
    admins = [
        {"v": 1, "what": "clear", "keep_static": False, **_WRITE},
        {"v": 1, "what": "reset"},
        {"v": 1, "what": "remove_frame", "name": "a", "subtree": True},
    ]
    operations: list[Any] = [
        ["lookup", _lookups()[0]],
        ["commit", _commits()[0]],
        ["info", infos[0]],
    ]
    batches = [
        {"v": 1, "operations": operations},
        {"v": 1, "operations": operations, **_WRITE},
        {"v": 1, "operations": [["lookup", _lookups()[4]], ["lookup", _lookups()[4]]]},
    ]
    found = {
        "commit": _commits(),
        "lookup": _lookups(),
        "info": infos,
        "admin": admins,
        "batch": batches,
        "snapshot": [
            wire.snapshot_request(None),
            wire.snapshot_request(wire.SnapshotRequest("0123456789abcdef", 0, 0, 100)),
        ],
        "missed": [wire.missed_request("0123456789abcdef", 1)],
        "set": _commits()[:3],
        "static": _commits()[3:],
    }
    return [Seed(request_type, body) for request_type, bodies in found.items() for body in bodies]


class Mutator:
    """Damages messages, drawn from a seed."""

    def __init__(self, seed: object) -> None:
        self._random = random.Random(str(seed))
        self._seeds = seeds()

    def next(self) -> tuple[str, bytes]:
        """A request type and a payload, which now and then is one of another type."""
        draw = self._random
        request_type, body = draw.choice(self._seeds)
        if draw.random() < 0.1:
            request_type = draw.choice(self._seeds).request_type
        if draw.random() < 0.6:
            body = self._changed(body)
        payload = bytearray(msgpack.packb(body, unicode_errors="surrogatepass"))
        if draw.random() < 0.5:
            self._damage(payload)
        return request_type, bytes(payload)

    def damaged(self, data: bytes) -> bytes:
        """The same bytes with some damage."""
        changed = bytearray(data)
        self._damage(changed)
        return bytes(changed)

    def _changed(self, body: dict[str, Any]) -> dict[str, Any]:
        """One or two fields hold something else, are gone, or are new."""
        body = dict(body)
        for _ in range(self._random.choice((1, 1, 2))):
            name = self._random.choice([*body, "new"])
            if self._random.random() < 0.2:
                body.pop(name, None)
            else:
                body[name] = self._value(body.get(name), 2)
        return body

    def _value(self, old: Any, depth: int) -> Any:
        draw = self._random
        kind = draw.randrange(8 if depth else 6)
        if kind == 0:
            return draw.choice(_NUMBERS)
        if kind == 1:
            return draw.choice(_TEXTS)
        if kind == 2:
            return draw.choice((None, True, False, 0.5, float("nan"), float("inf")))
        if kind == 3:
            return draw.randbytes(draw.choice((0, 1, 4, 7, 8, 16, 56, 112)))
        if kind in (4, 5) and isinstance(old, bytes) and old:
            changed = bytearray(old)
            self._damage(changed)
            return bytes(changed)
        if kind == 6:
            return {draw.choice(_TEXTS): self._value(old, depth - 1)}
        return [self._value(old, max(0, depth - 1)) for _ in range(draw.randrange(4))]

    def _damage(self, data: bytearray) -> None:
        """Change, insert, remove or repeat some bytes."""
        draw = self._random
        for _ in range(draw.choice((1, 1, 2, 4))):
            at = draw.randrange(len(data) + 1)
            kind = draw.randrange(5)
            if kind == 0 and at < len(data):
                data[at] ^= 1 << draw.randrange(8)
            elif kind == 1 and at < len(data):
                data[at] = draw.choice(_INTERESTING)
            elif kind == 2:
                data[at:at] = draw.randbytes(draw.randrange(1, 9))
            elif kind == 3:
                del data[at : at + draw.randrange(1, 9)]
            else:
                data[at:at] = data[at : at + draw.randrange(1, 65)]
