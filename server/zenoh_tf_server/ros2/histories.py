"""Asks publishers of `/tf_static` for what they sent before this server listened.

A publisher that keeps its last messages has a liveliness token. For each token that appears, its
owner is asked, and nobody else: so a publisher that does not answer delays no other. An
AdvancedSubscriber would ask all of them in one query, and hold back live messages until the last
one has answered, or 10 s have passed
(docs/explanation/decisions/0016-ros2-through-the-put-queues.md).

Thread safety: all methods.
"""

from __future__ import annotations

import heapq
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from zenoh_tf import threads
from zenoh_tf.errors import ProtocolError
from zenoh_tf.ros2 import keys
from zenoh_tf.ros2.keys import TF_MESSAGE, Publisher
from zenoh_tf.ros2.topics import Received, Reception

from ..rate_limited_log import RateLimitedLog
from .publishers import MAX_PUBLISHERS

TOPIC: Final = "tf_static"
_ANSWER_S: Final = 5.0
#: A publisher that has not answered is asked again after this time, and then after twice as long.
_RETRY_S: Final = 2.0
_LONGEST_RETRY_S: Final = 60.0
#: Where bridges before 1.5.1 keep messages, by the bridge's Zenoh id.
_OLD_CACHE: Final = "@ros2_pub_cache"
#: Replies that wait for this module's thread. If there is no room, the publisher is asked again.
_MAX_REPLIES: Final = 4096
_MAX_REPLY_BYTES: Final = 64 << 20


@dataclass(slots=True, eq=False)
class _Keeper:
    """A publisher that keeps messages."""

    selectors: list[str]
    zid: str
    retry_s: float = _RETRY_S
    asking: int = 0  # queries under way
    failed: bool = False


class Histories:
    """Follows the publishers that keep messages, and asks each for its own."""

    def __init__(
        self,
        appeared: Callable[[str, str], None],
        vanished: Callable[[str, str], None],
    ) -> None:
        """`appeared` and `vanished` get the data's key and the Zenoh id of a publisher that has
        come, or of whom the last token has gone."""
        self._appeared = appeared
        self._vanished = vanished
        self._changed = threading.Condition()
        self._keepers: dict[str, _Keeper] = {}  # by token
        self._later: list[tuple[float, str]] = []  # a heap of times and tokens
        self._replies: deque[tuple[zenoh.Sample, str]] = deque()  # and the publisher's id
        self._reply_bytes = 0
        self._closing = False
        self._failures = 0
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ros2"))
        self._thread: threading.Thread | None = None

    def attach(self, session: zenoh.Session) -> None:
        """Set the session, so that bridges can be asked; their replies wait for `start`."""
        self._session = session

    def start(
        self,
        receive: Callable[[Received], None],
        report: Callable[[str, ProtocolError], None],
    ) -> None:
        """Begin, after `attach`. `receive` gets messages, `report` what is malformed."""
        session = self._session
        self._own_zid = str(session.info.zid())
        self._receive = receive
        self._reception = Reception(TF_MESSAGE, report)
        self._thread = threads.start("ros2-histories", self._run)
        for data in (keys.rmw_data(TOPIC, TF_MESSAGE), keys.bridge_data(TOPIC)):
            self._subscribers.append(
                session.liveliness().declare_subscriber(
                    keys.histories(data), self._token_changed, history=True
                )
            )

    def close(self) -> None:
        """End."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        threads.join(self._thread)

    @property
    def failures(self) -> int:
        """How often a publisher has not answered."""
        return self._failures

    def ask_old_bridge(self, publisher: Publisher) -> None:
        """Ask a bridge from before there were tokens of publishers that keep messages."""
        topic = publisher.topic
        if not topic.is_bridged or topic.name != TOPIC:
            return
        key, cache = topic.path[1:], f"{_OLD_CACHE}/{publisher.zid}"
        self._ask(_Keeper([f"{key}/{cache}", f"{cache}/{key}"], publisher.zid), "")

    # --- tokens

    def _token_changed(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        found = keys.history_publisher(token)
        if found is None or keys.parse_data(found[0], TF_MESSAGE) is None:
            return
        if found[1] == self._own_zid:
            return  # what this server publishes
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._changed:
                gone = self._keepers.pop(token, None)
                prefix = f"{found[0]}/"
                is_last = gone is not None and not any(
                    each.zid == found[1] and other.startswith(prefix)
                    for other, each in self._keepers.items()
                )
            if is_last:
                self._vanished(*found)
            return
        with self._changed:
            if token in self._keepers:
                return
            if len(self._keepers) >= MAX_PUBLISHERS:
                self._log.warn(
                    "static transforms",
                    f"more than {MAX_PUBLISHERS} publishers keep some: the others are not asked "
                    "for what they sent before",
                )
                return
            keeper = self._keepers[token] = _Keeper([token], found[1])
        self._appeared(*found)
        self._ask(keeper, token)

    # --- queries

    def _ask(self, keeper: _Keeper, token: str) -> None:
        """Ask a publisher. Its own key differs from that of the messages: hence `_anyke`."""
        keeper.asking, keeper.failed = len(keeper.selectors), False

        def reply(reply: zenoh.Reply) -> None:
            # On Zenoh's own thread, which must not wait: for a token, for instance.
            if reply.ok is None or not self._queue(reply.ok, keeper.zid):
                keeper.failed = True

        def done() -> None:
            keeper.asking -= 1
            if keeper.failed and not keeper.asking:
                self._ask_later(keeper, token)

        for selector in keeper.selectors:
            self._session.get(
                f"{selector}?_anyke",
                Callback(reply, done, indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=_ANSWER_S,
            )

    def _ask_later(self, keeper: _Keeper, token: str) -> None:
        with self._changed:
            self._failures += 1
            if self._keepers.get(token) is not keeper:
                return
            heapq.heappush(self._later, (time.monotonic() + keeper.retry_s, token))
            keeper.retry_s = min(2 * keeper.retry_s, _LONGEST_RETRY_S)
            self._changed.notify_all()
        self._log.warn(
            token,
            "this publisher of static transforms does not answer: it is asked again later",
        )

    def _queue(self, sample: zenoh.Sample, zid: str) -> bool:
        """Hand a reply to this module's thread. False: there is no room."""
        size = len(sample.payload)
        with self._changed:
            if len(self._replies) >= _MAX_REPLIES or self._reply_bytes + size > _MAX_REPLY_BYTES:
                return False
            self._replies.append((sample, zid))
            self._reply_bytes += size
            self._changed.notify_all()
        return True

    def _run(self) -> None:
        while (found := self._next()) is not None:
            if isinstance(found, str):
                with self._changed:
                    keeper = self._keepers.get(found)
                if keeper is not None:
                    self._ask(keeper, found)
                continue
            message = self._reception.message(*found)
            if message is not None:
                self._receive(message)

    def _next(self) -> tuple[zenoh.Sample, str] | str | None:
        """Wait for a reply, or for a token whose publisher is to be asked again. None: closing."""
        with self._changed:
            while not self._closing:
                if self._replies:
                    reply = self._replies.popleft()
                    self._reply_bytes -= len(reply[0].payload)
                    return reply
                now_s = time.monotonic()
                if self._later and self._later[0][0] <= now_s:
                    return heapq.heappop(self._later)[1]
                self._changed.wait(self._later[0][0] - now_s if self._later else None)
        return None
