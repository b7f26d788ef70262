"""Transforms of other projects on Zenoh: keys, and the format of what is put there (``--ingest``).

From here on their messages are puts like any other: one transaction each, with the same limits,
counters and fair queues. Their authority is the key.

Thread safety: all methods.
"""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import formats, threads
from zenoh_tf._core import TransformRows
from zenoh_tf._net import keys
from zenoh_tf.errors import LimitExceeded, ProtocolError
from zenoh_tf.formats.rows import Decode
from zenoh_tf.text import quoted
from zenoh_tf.text.extras import pip_install

from ..limits import Limits
from .ingest import Ingest
from .put_queues import LARGE_BYTES, Put

#: Messages between Zenoh's receiver and a thread, and most that are handed over at once.
_CHANNEL: Final = 256
_BATCH: Final = 64


@dataclass(frozen=True, slots=True)
class ForeignKey:
    """``KEY=FORMAT``: what is put on these keys has this format."""

    key: str
    format: str


def parse(text: str) -> ForeignKey:
    """What a flag's value says: a type for argparse."""
    key, _, name = text.rpartition("=")
    if not key or name not in formats.NAMES:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not KEY=FORMAT, where FORMAT is one of {', '.join(formats.NAMES)}"
        )
    try:
        pattern = zenoh.KeyExpr(key)
    except zenoh.ZError as error:
        raise argparse.ArgumentTypeError(
            f"{quoted(key)} is no key expression of Zenoh: {error}"
        ) from error
    if pattern.intersects(zenoh.KeyExpr(f"{keys.PREFIX}/**")):
        raise argparse.ArgumentTypeError(
            f"{quoted(key)} matches this service's own keys, {keys.PREFIX}/**"
        )
    try:
        formats.decoder_of(name)
    except ImportError as error:
        raise argparse.ArgumentTypeError(
            f"the format {name} needs a library that cannot be imported ({error}); install it "
            f"with: {pip_install('recordings')}"
        ) from error
    return ForeignKey(key, name)


class Foreign:
    """Receives messages on foreign keys until it is closed."""

    def __init__(
        self,
        session: zenoh.Session,
        ingest: Ingest,
        limits: Limits,
        foreign: Sequence[ForeignKey],
    ) -> None:
        """Begin to receive."""
        self._ingest = ingest
        self._max_rows = limits.rows
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._threads: list[threading.Thread] = []
        for each in foreign:
            decode = self._decoder(formats.decoder_of(each.format))
            channel: FifoChannel[zenoh.Sample] = FifoChannel(_CHANNEL)
            subscriber = session.declare_subscriber(each.key, channel)
            self._subscribers.append(subscriber)
            # On the handler: undeclaring a subscriber fails while a thread waits on it.
            work = threads.start("ingest-foreign", self._run, subscriber.handler, decode)
            self._threads.append(work)

    def close(self) -> None:
        """Receive no more."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        threads.join(*self._threads)

    def _run(self, handler: Any, decode: Callable[[bytes], TransformRows]) -> None:
        try:
            while True:
                sample = handler.recv()
                puts: list[Put] = []
                while sample is not None and len(puts) < _BATCH:
                    if sample.kind == zenoh.SampleKind.PUT:
                        puts.append(_put_of(sample, decode))
                    sample = handler.try_recv() if len(puts) < _BATCH else None
                # While a queue of theirs presses, this thread waits, and Zenoh's channel fills.
                self._ingest.add(puts)
        except zenoh.ZError:  # undeclared
            return

    def _decoder(self, decode: Decode) -> Callable[[bytes], TransformRows]:
        def rows_of(payload: bytes) -> TransformRows:
            decoded = decode([payload])
            if decoded.malformed:
                raise ProtocolError(f"the message cannot be decoded: {decoded.first_fault}")
            if len(decoded.rows) > self._max_rows:
                raise LimitExceeded(
                    f"the message has {len(decoded.rows):,} transforms, the limit is "
                    f"{self._max_rows:,} (rows)",
                    field="rows",
                    limit=self._max_rows,
                )
            return decoded.rows

        return rows_of


def _put_of(sample: zenoh.Sample, decode: Callable[[bytes], TransformRows]) -> Put:
    payload: Any = sample.payload
    size = len(payload)
    if size <= LARGE_BYTES:  # a copy: Zenoh's own would keep the whole batch that it was in
        payload = payload.to_bytes()
    return Put(str(sample.key_expr), False, payload, size, time.time_ns(), decode)
