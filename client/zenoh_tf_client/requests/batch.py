"""The request of a batch, without any I/O: its message, and what its reply means."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

from zenoh_tf import wire
from zenoh_tf.errors import TransformException

from . import columns
from .handle import Handle
from .lookups import Read
from .request import Request, timeout_ns

_Settle = Callable[[wire.Message], None]


class BatchRequest(Request[None]):
    """All recorded operations in one message; its reply settles their handles."""

    request_type = "batch"

    def __init__(self, recorded: list[tuple[Request[Any], Handle[Any]]]) -> None:
        """Raises InvalidArgumentException if a time-out is out of range."""
        self.writes = any(request.writes for request, _ in recorded)
        self.wait_s = max(request.wait_s for request, _ in recorded)
        self._operations: list[tuple[str, wire.Message]] = []
        self._settlers: list[_Settle] = []  # for each operation a function that takes its reply
        # Neighbouring single reads with equal time-outs become one operation.
        for wait_s, group in itertools.groupby(recorded, _wait_of_read):
            if wait_s is None:
                for request, handle in group:
                    self._add(
                        request.request_type, request.body(), partial(handle._settle, request.parse)
                    )
            else:
                reads: list[tuple[Read[Any], Handle[Any]]] = list(group)  # type: ignore[arg-type]
                lookup = columns.join([read.row for read, _ in reads])
                lookup.timeout_ns = timeout_ns(wait_s)
                self._add("lookup", wire.lookup_body(lookup), _settler_of_reads(reads))

    def body(self) -> wire.Message:
        return wire.batch_body(self._operations)

    def parse(self, reply: wire.Message) -> None:
        replies = wire.parse_batch_reply(reply, len(self._operations))
        for settle, one in zip(self._settlers, replies, strict=True):
            settle(one)

    def _add(self, request_type: str, body: wire.Message, settle: _Settle) -> None:
        self._operations.append((request_type, body))
        self._settlers.append(settle)


def _wait_of_read(entry: tuple[Request[Any], Handle[Any]]) -> float | None:
    """The time-out of a single read; None for any other operation."""
    request, _ = entry
    return request.wait_s if isinstance(request, Read) else None


def _settler_of_reads(reads: list[tuple[Read[Any], Handle[Any]]]) -> _Settle:
    def settle(reply: wire.Message) -> None:
        try:
            answer = wire.parse_lookup_reply(reply, len(reads))
        except TransformException as error:
            for _, handle in reads:
                handle._fail(error)
            return
        for (read, handle), row in zip(reads, answer.rows(), strict=True):
            handle._settle(read.result, row)

    return settle
