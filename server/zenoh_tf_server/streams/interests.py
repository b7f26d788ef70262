"""Streams of parts of the tree, for mirrors that do not want all of it (`wire.Interest`).

An interest is read from the tree itself (`InterestReader`), so commits pay nothing for it. One
thread compares the versions of the frames of all interests every few milliseconds, and publishes
what is new of those that have changed; of thinned ones when their time has come. After a message,
changes are gathered for as long as the interest allows: at a sensor's rate, a message for each
change would cost more than what is in it. All mirrors with the same interest share one stream. It
works as the commit stream does: numbered messages, heartbeats, and the latest messages kept for
mirrors that missed some.

An interest ends some time after nobody listens to it any more, or when the clients that asked for
it have gone.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import threading
import time
from collections.abc import Iterator
from typing import Final

import zenoh

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf._core import InterestReader, wait_for_changes
from zenoh_tf._net import keys
from zenoh_tf.errors import LimitExceeded, ServerBusy, ServerRestarted, TransformException

from .. import fair_share
from ..limits import Limits
from .commit_stream import CommitStream
from .publisher import HEARTBEAT_S, StreamPublisher

log = logging.getLogger("zenoh_tf.server")

#: The versions of frames are compared so often, and at least four times in an interest's delay.
_LEAST_PERIOD_S: Final = 0.001
_PERIOD_S: Final = 0.01
#: New interests, and listeners that come and go, are noticed within this time.
_WAIT_S: Final = 0.05
#: After a change, the number of the last commit is published this soon, as someone may wait for it.
_SOON_S: Final = 0.02
#: The thread rests this many times as long as it works.
_REST: Final = 2.0
#: The size of an interest's latest messages that are kept for mirrors that missed some.
_KEPT_BYTES: Final = 256 << 10
#: An interest ends if nobody has listened to it for this long, or sooner if there are too many.
_UNHEARD_S: Final = 10.0
_UNHEARD_IF_BUSY_S: Final = 1.0


class _Interest:
    """One interest and its stream. Its owner's lock guards `clients`."""

    def __init__(
        self, interest: wire.Interest, tree: TransformTree, stream: CommitStream, instance: str
    ) -> None:
        self.wanted = interest
        self._stream = stream
        self.period_s = interest.period_ns / 1e9
        self.delay_s = interest.delay_ns / 1e9
        self.reader = InterestReader(tree, list(interest.pairs), bool(interest.period_ns))
        self.publisher = StreamPublisher(instance, _KEPT_BYTES, stream.real_ahead_ns)
        self.clients: set[str] = set()
        self.unheard_since_s: float | None = time.monotonic()  # None: someone listens
        self._lock = threading.Lock()  # guards what follows, and the order of the messages
        self._clock_ns = 0  # of the state in the last message
        self._state_s = 0.0  # when it was put
        self._has_changed = False  # in the last message

    def update_listeners(self) -> None:
        """Record whether someone listens."""
        if self.publisher.has_listeners():
            self.unheard_since_s = None
        elif self.unheard_since_s is None:
            self.unheard_since_s = time.monotonic()

    def due_s(self) -> float:
        """When the next message is due if nothing changes."""
        put_s = self.publisher.put_s
        if self.period_s:
            return min(self._state_s + self.period_s, put_s + HEARTBEAT_S)
        return put_s + (max(_SOON_S, self.delay_s) if self._has_changed else HEARTBEAT_S)

    def gathers_until_s(self) -> float:
        """When the next message may have changes."""
        return self._state_s + self.delay_s

    def snapshot(self, room: int, settings: wire.TreeSettings) -> wire.SnapshotPlan:
        """All that there is. Publishes what of it is new, so that the stream continues from it."""
        with self._lock:
            found, clock_ns = self._stream.read(self.reader, True, room)
            seq, reparented, changes, everything = found
            assert everything is not None
            self._put(seq, clock_ns, changes)
            bounds = wire.NO_BOUNDS
            return wire.SnapshotPlan(seq, reparented, bounds, settings, clock_ns, everything)

    def publish(self, room: int) -> None:
        """Publish what has changed; of a thinned stream whose time has not come, a heartbeat."""
        with self._lock:
            if self.period_s and time.monotonic() < self._state_s + self.period_s:
                self._put(self.publisher.last, self._clock_ns, None)
                return
            (seq, _, changes, _), clock_ns = self._stream.read(self.reader, False, room)
            self._put(seq, clock_ns, changes)

    def _put(self, last: int, clock_ns: int, changes: bytes | None) -> None:
        if clock_ns != self._clock_ns:
            self._state_s = time.monotonic()
        self._clock_ns = clock_ns
        self._has_changed = changes is not None
        self.publisher.put(last, clock_ns, changes)


class Interests:
    """The interests of all mirrors."""

    def __init__(
        self, tree: TransformTree, stream: CommitStream, instance: str, limits: Limits
    ) -> None:
        self._tree = tree
        self._stream = stream
        self._instance = instance
        self._limits = limits
        self._lock = threading.Lock()
        self._interests: dict[str, _Interest] = {}
        self._shares = fair_share.FairShare(limits, "interests")
        self._ended_messages = self._ended_bytes = 0  # of interests that have ended
        self._frames = 0  # of all interests, counted again at each sweep
        self._rest_until_s = 0.0  # of the thread
        self._changed = threading.Event()  # the interests, their listeners, or `_closing`
        self._closing = False
        self._session: zenoh.Session | None = None
        self._name = ""
        self._thread: threading.Thread | None = None

    def start(self, session: zenoh.Session, tree: str) -> None:
        """Publish to whoever listens to an interest of a tree."""
        self._session, self._name = session, tree
        self._thread = threads.start("interests", self._run)

    def close(self) -> None:
        """Publish no more."""
        self._closing = True
        self._changed.set()
        threads.join(self._thread)
        with self._lock:
            for interest_id in list(self._interests):
                self._end(interest_id)

    def snapshot(
        self, wanted: wire.Interest, client: str, settings: wire.TreeSettings
    ) -> wire.SnapshotPlan:
        """Begin to publish an interest, and return all that there is of it.

        Raises:
            LimitExceeded: It has too many pairs or frames.
            ServerBusy: There are too many interests, or too many frames in them.
        """
        self._limits.check("interest_pairs", len(wanted.pairs))
        for name in itertools.chain.from_iterable(wanted.pairs):
            self._limits.check("name_bytes", len(name.encode()))
        interest = self._add(wanted, client)
        with self._counted(interest) as room:
            plan = interest.snapshot(room, settings)
        self._changed.set()
        return plan

    def missed(self, interest_id: str, first: int) -> wire.Message:
        """The fields of the reply to `missed`: the messages from the number `first` on."""
        with self._lock:
            interest = self._interests.get(interest_id)
        if interest is None:
            raise ServerRestarted("the interest has ended: load a new snapshot")
        return interest.publisher.missed(first, self._stream.last_seq())

    def client_gone(self, client: str) -> None:
        """Give up what only this client wanted."""
        with self._lock:
            for interest in self._interests.values():
                if client in interest.clients:
                    interest.clients.discard(client)
                    self._shares.give_back(client, 1)
        self._changed.set()

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        with self._lock:
            running = list(self._interests.values())
            publishers = [one.publisher for one in running]
            return {
                "interests": len(running),
                "interest_frames": sum(one.reader.frames for one in running),
                "interest_messages": self._ended_messages + sum(p.messages for p in publishers),
                "interest_message_bytes": self._ended_bytes + sum(p.bytes for p in publishers),
            }

    # --- which there are

    def _add(self, wanted: wire.Interest, client: str) -> _Interest:
        with self._lock:
            interest = self._interests.get(wanted.id)
            if interest is None or client not in interest.clients:
                try:
                    self._shares.require_room(client, 1, _UNHEARD_IF_BUSY_S)
                except ServerBusy:
                    self._sweep(_UNHEARD_IF_BUSY_S)
                    self._shares.require_room(client, 1, _UNHEARD_IF_BUSY_S)
            if interest is None or wanted.id not in self._interests:
                interest = _Interest(wanted, self._tree, self._stream, self._instance)
                if self._session is not None:
                    key = keys.stream(self._name, self._instance, wanted.id)
                    interest.publisher.start(self._session, key, self._changed.set)
                self._interests[wanted.id] = interest
            if client not in interest.clients:
                interest.clients.add(client)
                self._shares.take_unchecked(client, 1)
            return interest

    def _sweep(self, unheard_s: float) -> None:
        """End those that nobody wants any more. Requires the lock."""
        now_s = time.monotonic()
        for interest_id, interest in list(self._interests.items()):
            since_s = interest.unheard_since_s
            if not interest.clients or (since_s is not None and now_s - since_s > unheard_s):
                self._end(interest_id)

    def _end(self, interest_id: str) -> None:
        interest = self._interests.pop(interest_id)
        self._frames -= interest.reader.frames
        for client in interest.clients:
            self._shares.give_back(client, 1)
        self._ended_messages += interest.publisher.messages
        self._ended_bytes += interest.publisher.bytes
        try:
            interest.publisher.close()
        except zenoh.ZError as error:  # the session is closed
            log.debug("cannot undeclare the stream of an interest: %s", error)

    @contextlib.contextmanager
    def _counted(self, interest: _Interest) -> Iterator[int]:
        """Yields how many frames an interest may have, and counts what it has afterwards."""
        before = interest.reader.frames
        with self._lock:
            room = self._room(interest)
        try:
            yield room
        except LimitExceeded as error:
            if error.field != "interest_frames" or not isinstance(error.value, int):
                raise
            raise self._no_room(error.value, self._frames - before + error.value) from None
        with self._lock:
            self._frames += interest.reader.frames - before

    def _room(self, interest: _Interest) -> int:
        """How many frames an interest may have. Those of an interest that its clients share count
        for each. An interest above its room ends when its next message is due. Requires the lock.
        """
        limit = self._limits.interest_frames
        free = max(limit - self._frames + interest.reader.frames, 0)
        if free >= limit // 2:  # more than any share
            return free
        held: dict[str, int] = {}
        for one in self._interests.values():
            for client in one.clients:
                held[client] = held.get(client, 0) + (
                    one.reader.frames if one is not interest else 0
                )
        return fair_share.room(limit, free, held, interest.clients)

    def _no_room(self, frames: int, total: int) -> LimitExceeded | ServerBusy:
        if frames > self._limits.interest_frames:
            return self._limits.exceeded("interest_frames", frames)
        why = "this client has its share of them"
        return fair_share.busy(self._limits, "interest_frames", total, why, _UNHEARD_IF_BUSY_S)

    # --- the thread

    def _run(self) -> None:
        next_sweep_s = 0.0
        while not self._closing:
            try:
                if self._changed.is_set() or time.monotonic() >= next_sweep_s:
                    self._changed.clear()
                    next_sweep_s = time.monotonic() + _UNHEARD_IF_BUSY_S
                    with self._lock:
                        for interest in self._interests.values():
                            interest.update_listeners()
                        self._sweep(_UNHEARD_S)
                        self._frames = sum(one.reader.frames for one in self._interests.values())
                self._publish(next_sweep_s)
            except Exception:  # the streams must continue
                log.exception("internal error in the streams of interests")
                time.sleep(HEARTBEAT_S)

    def _publish(self, next_sweep_s: float) -> None:
        """Wait until something is to be published, and publish it."""
        with self._lock:
            heard = [one for one in self._interests.values() if one.unheard_since_s is None]
            if not heard:
                is_empty = not self._interests
        if not heard:
            self._changed.wait(None if is_empty else max(next_sweep_s - time.monotonic(), 0))
            return
        now_s = time.monotonic()
        ready: list[_Interest] = []  # to be published as soon as they change
        until_s = now_s + _WAIT_S
        for one in heard:
            until_s = min(until_s, one.due_s())
            if not one.period_s:
                if one.gathers_until_s() <= now_s:
                    ready.append(one)
                else:
                    until_s = min(until_s, one.gathers_until_s())
        if ready and now_s < self._rest_until_s:
            time.sleep(self._rest_until_s - now_s)
            return
        readers = [one.reader for one in ready]
        delay_s = min((one.delay_s for one in ready), default=0.0)
        period_s = min(max(_LEAST_PERIOD_S, delay_s / 4), _PERIOD_S) if ready else _WAIT_S
        left_s = max(until_s, self._rest_until_s) - now_s
        changed = wait_for_changes(readers, period_s, max(left_s, 0))
        begin_s = time.monotonic()
        due = (one for one in heard if one.due_s() <= begin_s)
        published = dict.fromkeys(itertools.chain((ready[i] for i in changed), due))
        for interest in published:
            self._publish_one(interest)
        if published:
            end_s = time.monotonic()
            self._rest_until_s = end_s + max(_LEAST_PERIOD_S, _REST * (end_s - begin_s))

    def _publish_one(self, interest: _Interest) -> None:
        try:
            with self._counted(interest) as room:
                interest.publish(room)
        except TransformException as error:  # its mirrors learn why when they ask
            log.warning("an interest of %d pairs ends: %s", len(interest.wanted.pairs), error)
            with self._lock:
                if self._interests.get(interest.wanted.id) is interest:
                    self._end(interest.wanted.id)
