"""ROS 2 in: adds the messages of `/tf` and `/tf_static` to the server's put queues.

From there on they are puts like any other: one transaction each, with the same limits, counters
and fair queues. Their authority is the ROS node, or the bridge.

Thread safety: all methods.
"""

from __future__ import annotations

import logging
import threading
import time

import zenoh

from zenoh_tf._core import TransformRows
from zenoh_tf.errors import ProtocolError, TransformException
from zenoh_tf.ros2.cdr import decode_tf_message
from zenoh_tf.ros2.keys import TF_MESSAGE
from zenoh_tf.ros2.topics import Received, TopicListener
from zenoh_tf.text import quoted

from ..ingest.ingest import Ingest
from ..ingest.prefixes import Prefixes
from ..ingest.put_queues import LARGE_BYTES, Put
from ..limits import Limits
from ..rate_limited_log import RateLimitedLog
from .publishers import Decode, Publishers, Source
from .statics import Statics


class Incoming:
    """Receives transforms until it is closed."""

    def __init__(
        self,
        session: zenoh.Session,
        ingest: Ingest,
        limits: Limits,
        publishers: Publishers,
        prefixes: Prefixes,
        statics: Statics,
    ) -> None:
        self._ingest = ingest
        self._limits = limits
        self._publishers = publishers
        self._prefixes = prefixes
        self._statics = statics
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ros2"))
        self._lock = threading.Lock()
        self._counts = {"ros2_messages": 0, "ros2_bad_keys": 0, "ros2_bad_attachments": 0}
        self._listeners = [
            TopicListener(session, topic, TF_MESSAGE, receive, self.report)
            for topic, receive in (("tf", self._receive), ("tf_static", self._receive_static))
        ]
        self._statics.start(self._receive_history, self.report)

    def close(self) -> None:
        """Receive no more."""
        for listener in self._listeners:
            listener.close()
        self._statics.close()

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        with self._lock:
            counts = dict(self._counts)
        return counts | {"ros2_publishers": len(self._publishers)} | self._statics.counters()

    def report(self, key: str, error: ProtocolError) -> None:
        """Count and log a malformed key or attachment."""
        with self._lock:
            self._counts["ros2_bad_keys" if error.field == "key" else "ros2_bad_attachments"] += 1
        self._log.warn(f"ROS 2 message on {quoted(key)}", str(error))

    # --- messages

    def _receive(self, messages: list[Received]) -> None:
        now_ns = time.time_ns()
        puts: list[Put] = []
        for message in messages:
            source = self._publishers.source(message)
            if source.is_copy:
                continue
            decode = source.decode or self._add_decoder(source)
            size = len(message.payload)
            payload = message.payload if size > LARGE_BYTES else message.payload.to_bytes()
            puts.append(Put(source.authority, False, payload, size, now_ns, decode))
        with self._lock:
            self._counts["ros2_messages"] += len(puts)
        self._ingest.add(puts)

    def _receive_static(self, messages: list[Received]) -> None:
        self._add_statics(messages, wait=True)

    def _receive_history(self, message: Received) -> None:
        self._add_statics([message], wait=False)

    def _add_statics(self, messages: list[Received], *, wait: bool) -> None:
        """Put what is new in messages of `/tf_static`. What cannot be decoded is left to the put
        queue, which refuses it as any put."""
        accepted = 0
        for message in messages:
            source = self._publishers.source(message)
            if source.is_copy:
                continue
            accepted += 1
            decode = source.decode or self._add_decoder(source)
            size = len(message.payload)
            put = Put(source.authority, True, message.payload, size, time.time_ns(), decode)
            if size <= self._limits.message_bytes:
                put.payload = message.payload.to_bytes()
                try:
                    rows = decode(put.payload)
                    news = self._statics.record(source, message.number, rows, live=wait)
                except TransformException:
                    pass
                else:
                    if news is None:
                        continue
                    put = news
            self._ingest.add([put], wait=wait)
        with self._lock:
            self._counts["ros2_messages"] += accepted

    def _add_decoder(self, source: Source) -> Decode:
        source.decode = self._decoder(source)
        return source.decode

    def _decoder(self, source: Source) -> Decode:
        max_rows = self._limits.rows
        try:
            rename = self._prefixes.renamer(self._prefixes.prefix(source.topic, source.zid))
        except TransformException as error:
            refusal = error

            def refuse(payload: bytes) -> TransformRows:
                raise type(refusal)(str(refusal), **refusal.facts)

            return refuse

        def decode(payload: bytes) -> TransformRows:
            return decode_tf_message(payload, max_rows, rename)

        return decode
