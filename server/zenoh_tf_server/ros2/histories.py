"""Asks publishers of `/tf_static` for what they sent before this server listened.

A publisher that keeps its last messages has a liveliness token. For each token that appears, its
owner is asked, and nobody else: so a publisher that does not answer delays no other. An
AdvancedSubscriber would ask all of them in one query, and hold back live messages until the last
one has answered, or 10 s have passed
(docs/explanation/decisions/0016-ros2-through-the-put-queues.md).

A publisher may also declare that it keeps messages (transient-local), and keep none. So each one
that declares it, and has sent nothing when asked, is asked again: some time after it has appeared,
and after its next live message. While it sends nothing, it is counted as silent.

Thread safety: all methods.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from zenoh_tf import threads
from zenoh_tf.errors import ProtocolError
from zenoh_tf.ros2 import attachment, keys
from zenoh_tf.ros2.keys import TF_MESSAGE, TopicPublisher
from zenoh_tf.ros2.publishers import MAX_PUBLISHERS, NODE
from zenoh_tf.ros2.topics import Received, Reception

from ..rate_limited_log import RateLimitedLog

TOPIC: Final = "tf_static"
_ANSWER_S: Final = 5.0
#: A publisher that has not answered is asked again after this time, and then after twice as long.
_RETRY_S: Final = 2.0
_LONGEST_RETRY_S: Final = 60.0
#: A publisher that declares to keep messages is asked this long after it has appeared or sent one.
_CHECK_S: Final = 2.0
#: Where bridges before 1.5.1 keep messages, by the bridge's Zenoh id.
_OLD_CACHE: Final = "@ros2_pub_cache"
#: Replies that wait for this module's thread. If there is no room, the publisher is asked again.
_MAX_REPLIES: Final = 4096
_MAX_REPLY_BYTES: Final = 64 << 20

#: The data's key, and the Zenoh id of the session.
_Identity = tuple[str, str]
#: Gets publishers that have come (True), or are gone and would send again what they keep (False):
#: that of an id, or all of a session on a key.
CameOrWent = Callable[[_Identity, bytes | None, bool], None]


@dataclass(slots=True, eq=False)
class _Keeper:
    """The publishers of one session on one key that keep messages, or declare to."""

    identity: _Identity
    tokens: set[str] = field(default_factory=set)  # of those that can be asked
    had_token: bool = False
    #: By their tokens: those that declare to keep messages.
    declared: dict[str, TopicPublisher] = field(default_factory=dict)
    #: Before it is asked again if it has not answered.
    pauses: Iterator[float] = field(
        default_factory=lambda: threads.pauses(_RETRY_S, _LONGEST_RETRY_S)
    )
    asking: int = 0  # queries under way
    is_due: bool = False  # it is to be asked again at some time
    failed: bool = False  # the last query
    answered: bool = False  # some message was there
    is_silent: bool = False  # it declares to keep messages, and sent none when asked
    was_checked_again: bool = False  # after a live message
    was_reported: bool = False

    @property
    def keeps(self) -> bool:
        """True if its publishers send again what they have sent, so that it may go with them."""
        return self.had_token and not self.is_silent


@dataclass(slots=True, eq=False)
class _Question:
    """A query, or some, to one keeper."""

    keeper: _Keeper
    is_check: bool  # all of its publishers are asked: no reply means that none keeps a message
    left: int
    failed: bool = False
    answered: bool = False


class Histories:
    """Follows the publishers that keep messages, and asks each for its own."""

    def __init__(
        self,
        session: zenoh.Session,
        came_or_went: CameOrWent,
        receive: Callable[[Received], None],
        report: Callable[[str, ProtocolError], None],
    ) -> None:
        """Bridges can be asked at once; what they reply waits for `start`.

        `receive` gets messages, and `report` what is malformed."""
        self._session = session
        self._own_zid = str(session.info.zid())
        self._came_or_went = came_or_went
        self._receive = receive
        self._reception = Reception(TF_MESSAGE, report)
        self._lock = threading.Lock()
        self._keepers: dict[_Identity, _Keeper] = {}
        self._tokens: set[str] = set()  # of all keepers
        self._replies = self._reply_bytes = 0  # that wait
        #: How often a publisher has not answered.
        self.failures = 0
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ros2"))
        self._loop = asyncio.new_event_loop()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to ask, and to receive the replies."""
        self._thread = threads.start("ros2-histories", self._loop.run_forever)
        for data in keys.data(TOPIC, TF_MESSAGE):
            subscriber = self._session.liveliness().declare_subscriber(
                keys.histories(data), self._token_changed, history=True
            )
            self._subscribers.append(subscriber)

    def close(self) -> None:
        """End."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._loop.call_soon_threadsafe(self._loop.stop)
        threads.join(self._thread)

    @property
    def silent(self) -> int:
        """How many publishers declare to keep messages, and sent none when asked."""
        with self._lock:
            return sum(
                len(keeper.declared) for keeper in self._keepers.values() if keeper.is_silent
            )

    # --- publishers that declare to keep messages

    def publisher_found(self, publisher: TopicPublisher) -> None:
        """Follow a publisher that declares to keep messages. A bridge from before there were tokens
        of those that do is asked at once."""
        if publisher.topic.name != TOPIC:
            return
        identity = (publisher.data, publisher.zid)
        # A server like this one keeps messages, and sends none before it has any.
        declares = publisher.is_latched and publisher.node != f"/{NODE}"
        with self._lock:
            keeper = self._keepers.get(identity) or _Keeper(identity)
            if declares:
                self._keepers[identity] = keeper
                keeper.declared[publisher.token] = publisher
                self._ask_later(keeper, _CHECK_S)
        if declares and (gid := _gid(publisher)) is not None:
            self._came_or_went(identity, gid, True)
        if publisher.topic.is_bridged:
            self._ask(keeper, _old_caches(identity))

    def publisher_gone(self, publisher: TopicPublisher) -> None:
        """Follow a publisher no more."""
        with self._lock:
            keeper = self._keepers.get((publisher.data, publisher.zid))
            if keeper is None or keeper.declared.pop(publisher.token, None) is None:
                return
            is_last = self._is_gone(keeper)
        if not keeper.keeps:
            return
        # Also of the last one, which does not come back with the next publisher of its session.
        if (gid := _gid(publisher)) is not None:
            self._came_or_went(keeper.identity, gid, False)
        # Without an id, messages are not those of this publisher but of its session.
        if is_last:
            self._came_or_went(keeper.identity, None, False)

    def has_sent(self, identity: _Identity) -> None:
        """Ask a silent publisher once more, now that it has sent a message."""
        keeper = self._keepers.get(identity)
        if keeper is None or not keeper.is_silent or keeper.was_checked_again:
            return  # the common case, without the lock
        with self._lock:
            keeper.was_checked_again = True
            self._ask_later(keeper, _CHECK_S)

    # --- tokens of publishers that can be asked

    def _token_changed(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        identity = keys.history_publisher(token)
        if identity is None or keys.parse_data(identity[0], TF_MESSAGE) is None:
            return
        if identity[1] == self._own_zid:
            return  # what this server publishes
        if sample.kind == zenoh.SampleKind.DELETE:
            self._token_removed(identity, token)
            return
        with self._lock:
            if token in self._tokens:
                return
            if len(self._tokens) >= MAX_PUBLISHERS:
                self._log.warn(
                    "static transforms",
                    f"more than {MAX_PUBLISHERS} publishers keep some: the others are not asked "
                    "for what they sent before",
                )
                return
            self._tokens.add(token)
            keeper = self._keepers.setdefault(identity, _Keeper(identity))
            keeper.tokens.add(token)
            keeper.had_token = True
        self._came_or_went(identity, None, True)
        self._ask(keeper, [token])

    def _token_removed(self, identity: _Identity, token: str) -> None:
        with self._lock:
            keeper = self._keepers.get(identity)
            if keeper is None or token not in keeper.tokens:
                return
            self._tokens.discard(token)
            keeper.tokens.discard(token)
            is_last = self._is_gone(keeper)
        if keeper.keeps and is_last:
            self._came_or_went(identity, None, False)

    def _is_gone(self, keeper: _Keeper) -> bool:
        """Forget a keeper that has neither tokens nor declared publishers, and return True.

        Both must have gone, as a token that goes alone can be reported after messages that were
        sent without it. Requires the lock.
        """
        if keeper.tokens or keeper.declared:
            return False
        del self._keepers[keeper.identity]
        return True

    # --- queries

    def _ask(self, keeper: _Keeper, selectors: list[str], *, is_check: bool = False) -> None:
        """Ask publishers. Their own keys differ from that of the messages: hence `_anyke`."""
        zid = keeper.identity[1]
        question = _Question(keeper, is_check, len(selectors))
        with self._lock:
            keeper.asking += len(selectors)

        def reply(reply: zenoh.Reply) -> None:
            # On Zenoh's own thread, which must not wait: for a token, for instance.
            if reply.ok is None or not self._queue(reply.ok, zid):
                question.failed = True
            else:
                question.answered = True

        for selector in selectors:
            self._session.get(
                f"{selector}?_anyke",
                Callback(reply, lambda: self._ended(question), indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=_ANSWER_S,
            )

    def _ended(self, question: _Question) -> None:
        """One query of a question has ended, after its replies."""
        keeper = question.keeper
        with self._lock:
            keeper.asking -= 1
            question.left -= 1
            if question.left:
                return
            keeper.failed = question.failed
            keeper.answered |= question.answered
            if question.failed:
                self.failures += 1
                self._ask_later(keeper, next(keeper.pauses))
            elif question.is_check or keeper.answered:
                keeper.is_silent = not keeper.answered
            is_new = keeper.is_silent and not keeper.was_reported
            keeper.was_reported |= is_new
            silent = list(keeper.declared.values()) if is_new else []
        key, zid = keeper.identity
        if question.failed:
            self._log.warn(
                f"{key} of session {zid}",
                "this publisher of static transforms does not answer: it is asked again later",
            )
        for publisher in silent:
            node = f"node {publisher.node}" if publisher.node else f"bridge {zid}"
            self._log.warn(
                f"{publisher.topic.path} of {node}",
                "it declares to keep its static transforms (transient-local), but sent none when "
                "asked: those from before this server's start are missing, unless --state-dir has "
                "kept them",
            )

    def _ask_later(self, keeper: _Keeper, after_s: float) -> None:
        """Ask all publishers of a keeper, unless that is to happen anyway. Requires the lock."""
        if keeper.is_due or self._keepers.get(keeper.identity) is not keeper:
            return
        keeper.is_due = True
        self._loop.call_soon_threadsafe(self._loop.call_later, after_s, self._ask_again, keeper)

    def _ask_again(self, keeper: _Keeper) -> None:
        """Ask publishers whose time has come, unless they are gone or have answered."""
        with self._lock:
            keeper.is_due = False
            if self._keepers.get(keeper.identity) is not keeper:
                return
            if keeper.asking:  # the queries' outcome decides
                self._ask_later(keeper, _CHECK_S)
                return
            if keeper.answered and not keeper.failed:
                return
            is_check = bool(keeper.declared)
        key, zid = keeper.identity
        selectors = [keys.session_histories(key, zid)]
        topic = keys.parse_data(key, TF_MESSAGE)
        if topic is not None and topic.is_bridged:
            selectors += _old_caches(keeper.identity)
        self._ask(keeper, selectors, is_check=is_check)

    def _queue(self, sample: zenoh.Sample, zid: str) -> bool:
        """Hand a reply to this module's thread. False: there is no room."""
        size = len(sample.payload)
        with self._lock:
            if self._replies >= _MAX_REPLIES or self._reply_bytes + size > _MAX_REPLY_BYTES:
                return False
            self._replies += 1
            self._reply_bytes += size
        self._loop.call_soon_threadsafe(self._replied, sample, zid, size)
        return True

    def _replied(self, sample: zenoh.Sample, zid: str, size: int) -> None:
        with self._lock:
            self._replies -= 1
            self._reply_bytes -= size
        message = self._reception.message(sample, zid)
        if message is not None:
            self._receive(message)


def _gid(publisher: TopicPublisher) -> bytes | None:
    """The id that a publisher's messages carry; None if they carry none, or it is not known."""
    return None if publisher.topic.is_bridged else attachment.gid_of(publisher.token)


def _old_caches(identity: _Identity) -> list[str]:
    """Where a bridge from before there were tokens keeps the messages of a key."""
    key, zid = identity
    cache = f"{_OLD_CACHE}/{zid}"
    return [f"{key}/{cache}", f"{cache}/{key}"]
