"""The kept inputs: real messages, and files of those that once reached new code or broke it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgpack

from zenoh_tf._net import keys

from .seeds import Mutator, seeds

CORPUS = Path(__file__).parent / "corpus"
_KEYS = ("main", "%", "%2F", "a%20b", "%25%0A", "\u2028", "é", "x" * 255, "%2f", "%ZZ")
_CONFIG = b"""
cache-time = "30s"
listen = ["tls/0.0.0.0:7447"]
users = "users"
tls-certificate = "server.pem"
tls-key = "server.key"
[limits]
rows = 1000
[[access]]
users = ["nav"]
may = ["read"]
publish = ["wheels*"]
"""


def as_input(target: str, request_type: str, payload: bytes) -> bytes:
    """A message as an input of a target; the handler's begins with its type."""
    if target != "handler":
        return payload
    known = request_type if request_type in keys.REQUEST_TYPES else "commit"
    return bytes([keys.REQUEST_TYPES.index(known)]) + payload


def first_inputs(target: str) -> Iterator[bytes]:
    """The inputs that a target is fuzzed from."""
    if target == "key":
        yield from (text.encode() for text in _KEYS)
        return
    if target == "config":
        yield _CONFIG
        return
    for request_type, body in seeds():
        yield as_input(target, request_type, msgpack.packb(body))


def kept(target: str) -> Iterator[bytes]:
    """The files of the corpus."""
    for path in sorted((CORPUS / target).glob("*")):
        yield path.read_bytes()


def mutated(target: str, count: int, seed: object) -> Iterator[bytes]:
    """Damaged messages, or for other targets damaged texts."""
    mutator = Mutator(seed)
    texts = [] if target in ("decoder", "handler") else list(first_inputs(target))
    for index in range(count):
        if texts:
            yield mutator.damaged(texts[index % len(texts)])
        else:
            yield as_input(target, *mutator.next())
