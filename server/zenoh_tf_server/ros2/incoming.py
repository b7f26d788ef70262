"""ROS 2 in: adds the messages of `/tf` and `/tf_static` to the server's put queues.

From there on they are puts like any other: one transaction each, with the same limits, counters
and fair queues. Their authority is the ROS node, or the bridge.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time

import zenoh

from zenoh_tf._core import TransformRows
from zenoh_tf.errors import ProtocolError, TransformException
from zenoh_tf.ros2.cdr import decode_tf_message
from zenoh_tf.ros2.keys import TF_MESSAGE
from zenoh_tf.ros2.publishers import Decode, Publishers, TopicSource
from zenoh_tf.ros2.topics import Received, TopicListener
from zenoh_tf.text import quoted

from ..ingest.ingest import Ingest
from ..ingest.prefixes import Prefixes
from ..ingest.put_queues import LARGE_BYTES, Put
from ..limits import Limits
from ..rate_limited_log import RateLimitedLog
from ..state.static_links import StaticLinks
from .histories import Histories
from .settings import Ros2Settings
from .statics import Statics


class Incoming:
    """Receives transforms until it is closed."""

    def __init__(
        self,
        session: zenoh.Session,
        ingest: Ingest,
        links: StaticLinks,
        limits: Limits,
        settings: Ros2Settings,
    ) -> None:
        self._ingest = ingest
        self._limits = limits
        self._prefixes = Prefixes(settings.rules, settings.shared)
        self._has_rules = bool(settings.rules)
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ros2"))
        self._lock = threading.Lock()
        self._counts = {"ros2_messages": 0, "ros2_bad_keys": 0, "ros2_bad_attachments": 0}
        self._statics = Statics(
            links, settings.static_grace_s, lambda puts: ingest.add(puts, wait=False)
        )
        self._histories = histories = Histories(
            session, self._statics.came_or_went, self._receive_history, self._report
        )
        self._publishers = Publishers(
            session,
            TF_MESSAGE,
            self._log.warn,
            histories.publisher_found,
            histories.publisher_gone,
        )
        self._listeners = [
            TopicListener(session, topic, TF_MESSAGE, receive, self._report)
            for topic, receive in (("tf", self._receive), ("tf_static", self._receive_static))
        ]
        histories.start()

    def close(self) -> None:
        """Receive no more."""
        for listener in self._listeners:
            listener.close()
        self._histories.close()
        self._statics.close()
        self._publishers.close()

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        with self._lock:
            counts = dict(self._counts)
        return {
            **counts,
            **self._statics.counters(),
            "ros2_publishers": len(self._publishers),
            "ros2_unanswered": self._histories.failures,
            "ros2_silent": self._histories.silent,
        }

    def _report(self, key: str, error: ProtocolError) -> None:
        """Count and log a malformed key or attachment."""
        with self._lock:
            self._counts["ros2_bad_keys" if error.field == "key" else "ros2_bad_attachments"] += 1
        self._log.warn(f"ROS 2 message on {quoted(key)}", str(error))

    # --- messages

    def _receive(self, messages: list[Received]) -> None:
        found = [self._put(message, static=False) for message in messages]
        puts = [one[1] for one in found if one is not None]
        self._count(len(puts))
        self._ingest.add(puts)

    def _receive_static(self, messages: list[Received]) -> None:
        self._add_statics(messages, live=True)

    def _receive_history(self, message: Received) -> None:
        self._add_statics([message], live=False)

    def _put(self, message: Received, *, static: bool) -> tuple[TopicSource, Put] | None:
        """A message as a put, and where it comes from; None: it is a copy of another one."""
        source = self._publishers.source(message)
        if source.is_copy:
            return None
        decode = source.decode or self._add_decoder(source)
        size = len(message.payload)
        payload = message.payload if size > LARGE_BYTES else message.payload.to_bytes()
        return source, Put(source.authority, static, payload, size, time.time_ns(), decode)

    def _add_statics(self, messages: list[Received], *, live: bool) -> None:
        """Put what is new in messages of `/tf_static`. What cannot be decoded is left to the put
        queue, which refuses it as any put. `live`: they were sent now, so this may wait."""
        for message in messages:
            found = self._put(message, static=True)
            if found is None:
                continue
            self._count(1)
            source, put = found
            if put.size <= self._limits.message_bytes and put.decode is not None:
                with contextlib.suppress(TransformException):
                    rows = put.decode(message.payload.to_bytes())
                    if live:
                        self._histories.has_sent(source.identity[:2])
                    news = self._statics.record(source, message, rows, live=live)
                    if news is None:
                        continue
                    put = news
            self._ingest.add([put], wait=live)

    def _count(self, messages: int) -> None:
        with self._lock:
            self._counts["ros2_messages"] += messages

    def _add_decoder(self, source: TopicSource) -> Decode:
        source.decode = self._decoder(source)
        return source.decode

    def _decoder(self, source: TopicSource) -> Decode:
        max_rows = self._limits.rows
        try:
            prefix = self._prefixes.prefix(source.topic, source.zid)
        except TransformException as error:
            refusal = error

            def refuse(payload: bytes) -> TransformRows:
                raise type(refusal)(str(refusal), **refusal.facts)

            return refuse

        if self._has_rules and not prefix:
            topic = f"ROS 2 topic {quoted(source.topic.path)}"
            self._log.warn(topic, "no --ros2-prefix is for this robot: its frames get no prefix")
        rename = self._prefixes.renamer(prefix)

        def decode(payload: bytes) -> TransformRows:
            return decode_tf_message(payload, max_rows, rename)

        return decode
