"""Interests of mirrors: which frames one wants, and how often ("interest" in
docs/reference/protocol.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgpack
import numpy as np

from .fields import U32, Message, indexes, integer, malformed, mapping, raw, text, texts

#: Bytes of an interest's id.
_ID_BYTES = 16


@dataclass(frozen=True, slots=True)
class Interest:
    """What a mirror wants to have. Equal ones share a stream."""

    #: The paths between these frames, each pair and the list sorted; empty: all frames.
    pairs: tuple[tuple[str, str], ...]
    #: Only the newest samples, once in so many nanoseconds; 0: all samples, at once.
    period_ns: int = 0
    #: How long the server may gather changes.
    delay_ns: int = 0

    @classmethod
    def of(
        cls, pairs: Iterable[tuple[str, str]], period_ns: int = 0, delay_ns: int = 0
    ) -> Interest:
        """The same for all orders of the pairs and within them."""
        ordered = {(min(pair), max(pair)) for pair in pairs}
        return cls(tuple(sorted(ordered)), period_ns, delay_ns)

    @property
    def id(self) -> str:
        """Names the stream."""
        import hashlib  # noqa: PLC0415 - it loads OpenSSL, which is slow

        pairs = [list(pair) for pair in self.pairs]
        data: bytes = msgpack.packb([pairs, self.period_ns, self.delay_ns])
        return hashlib.blake2b(data, digest_size=_ID_BYTES).hexdigest()

    def fields(self) -> Message:
        """The map in a request."""
        names = sorted({name for pair in self.pairs for name in pair})
        index = {name: i for i, name in enumerate(names)}
        columns = np.array([[index[a], index[b]] for a, b in self.pairs], U32).reshape(-1, 2)
        return {
            "id": self.id,
            "names": names,
            "target": raw(columns[:, 0], U32),
            "source": raw(columns[:, 1], U32),
            "period_ns": self.period_ns,
            "delay_ns": self.delay_ns,
        }


def parse_interest(body: Message) -> Interest | None:
    """The interest in a request for a snapshot; None: everything. Raises ProtocolError."""
    if "interest" not in body:
        return None
    fields = mapping(body, "interest")
    names = texts(fields, "names")
    target = indexes(fields, "target", None, len(names))
    source = indexes(fields, "source", target.size, len(names))
    period_ns = integer(fields, "period_ns", 0, low=0)
    delay_ns = integer(fields, "delay_ns", 0, low=0)
    pairs = [(names[a], names[b]) for a, b in zip(target.tolist(), source.tolist(), strict=True)]
    if not period_ns and not pairs:
        raise malformed("target", "not empty, or a period_ns")
    interest = Interest.of(pairs, period_ns, delay_ns)
    if text(fields, "id") != interest.id:
        raise malformed("id", "the digest of the interest")
    return interest
