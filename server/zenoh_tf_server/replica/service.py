"""The service of a replica: a `CopyService` for each copy of the primary's tree, in turn.

A request is served by the copy that is complete when it comes, and its reply says how old that is.
While a new copy is made, the last one answers. Instance, versions, numbers and clock in replies are
the primary's, because the commits are.

Thread safety: all methods.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import zenoh

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf.errors import ServerBusy, ServerUnavailable, TransformException
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.mirrors.source import Source, State
from zenoh_tf.steps import run
from zenoh_tf.text import quoted

from ..limits import Limits
from ..requests.guard import RequestGuard
from ..requests.handler import Handler, ReplyCallback, ReplyWithField
from .copies import SharedCopies
from .copy_service import CopyService

#: Time-out of the first copy.
_COPY_TIMEOUT_S: Final = 30.0
#: Lookups that wait in a copy that was replaced end after this time, and are asked again.
_REPLACED_S: Final = 0.5
#: As many instances of the primary are remembered.
_MAX_PAST: Final = 16
#: In place of an age that is not known.
_MAX_AGE_S: Final = 1e9
#: A copy that is younger than this gets a commit that it lacks within milliseconds.
_YOUNG_S: Final = 1.0
_SOON_S: Final = 0.002
_LATER_S: Final = 0.05


class ReplicaService(Handler):
    """Serves a tree from copies of it."""

    def __init__(
        self,
        name: str,
        primary: str,
        limits: Limits,
        loop: asyncio.AbstractEventLoop,
        copies: SharedCopies,
        source: Source,
        session: zenoh.Session,
        guard: RequestGuard,
        serves: Callable[[str], None],
        is_connected: Callable[[str], bool],
    ) -> None:
        """Follow the primary, `source`. `primary`: its endpoints, for messages. `copies` makes the
        trees. `session`: towards the clients. `serves` is called with each instance of the primary
        whose tree is served from then on. `is_connected`: whether a client's token is there."""
        super().__init__(name, limits, guard)
        self.primary = primary
        self.session = session
        self.loop = loop
        self.is_connected = is_connected
        self._copies = copies
        self._source = source
        self._serves = serves
        self._plan: wire.TreeSettings | None = None  # of the copy that is made
        #: By copy; besides the current one, the one before it for a moment.
        self._services: dict[TransformTree, CopyService] = {}
        self._current: CopyService | None = None  # the one that gets what comes
        self._past: deque[str] = deque(maxlen=_MAX_PAST)  # instances that are gone
        self._is_asking = False  # whether another instance is one of them
        self._is_made = threading.Event()
        # Last: it calls.
        self.feed = MirrorFeed(source, self._take, make_tree=self._make_tree, observer=self)
        self._is_made.set()

    def wait_for_copy(self) -> None:
        """Wait for the first copy.

        Raises:
            TransformException: There is none in time.
        """
        self.feed.wait_for_copy(_COPY_TIMEOUT_S)

    def close(self) -> None:
        """Follow the primary no more, and answer what waits."""
        self.feed.close()
        self._copies.close()
        for service in list(self._services.values()):
            service.close()

    @property
    def instance(self) -> str:
        """The primary's instance whose state is served."""
        return self.feed.state.instance

    @property
    def age_s(self) -> float:
        """How old what is served may be, in seconds."""
        return self._age_s(self.feed.state)

    def handle(
        self, request_type: str, payload: bytes, reply_to: ReplyCallback, chunk: str | None = None
    ) -> None:
        state = self.feed.state  # before the read, which may see more
        service = None if state.tree is None else self._services.get(state.tree)
        if service is None:
            reply_to(self.error(ServerUnavailable("the replica is stopping")), True)
        else:
            age_ns = int(self._age_s(state) * 1e9)
            dated = ReplyWithField(reply_to, wire.AGE_NS, lambda: age_ns)
            service.handle(request_type, payload, dated, chunk)

    def client_gone(self, client: str) -> None:
        for service in list(self._services.values()):
            service.client_gone(client)

    def authorities(self) -> list[str]:
        """The names of those that have published to the primary."""
        return [record["name"] for record in self.info_requests.authorities()]

    def stats(self) -> dict[str, int]:
        """Those of the latest copy; there is one once `wait_for_copy` has returned."""
        return next(reversed(list(self._services.values()))).stats()

    # --- what the feed calls, under its lock; see `mirrors.copy.Observer`

    def begin(self, instance: str, seq: int) -> None:
        """Another copy begins: the current one gets no more."""
        self._current = None

    def load(self, frames: bytes) -> None:
        """Nothing: nobody follows a copy that is not complete."""

    def apply(self, message: wire.StreamMessage) -> None:
        """Let the mirrors of clients have what the copy has got."""
        if self._current is not None:
            self._current.relay.apply(message)

    def _make_tree(self, plan: wire.TreeSettings, instance: str) -> TransformTree:
        self._plan = plan
        return self._copies.make_tree(plan, instance)

    def _take(self, tree: TransformTree | None, instance: str) -> None:
        """Serve a new copy, which `state` has right after this."""
        if tree is None:
            return
        self._is_made.wait()
        assert self._plan is not None
        # From here on no client reads the copy before this one in memory.
        offer = self._copies.share(tree, self.limits)
        service = CopyService(self, tree, instance, self._plan, offer)
        self.clocks, self.info_requests = service.clocks, service.info_requests
        replaced = dict(self._services)
        self._services[tree] = self._current = service
        self._serves(instance)
        if replaced:
            threads.start("replaced copy", self._end, replaced, instance)

    def _end(self, replaced: dict[TransformTree, CopyService], instance: str) -> None:
        time.sleep(_REPLACED_S)
        for tree, service in replaced.items():
            if service.instance != instance:
                self._add_past(service.instance)
            self._services.pop(tree, None)
            service.close()

    def counters(self) -> dict[str, Any]:
        """Counters for `stats`."""
        return {
            "replica_age_s": self.age_s,
            "replica_seq": self.feed.state.seq,
            "replica_snapshots": self.feed.snapshots,
            "replica_contradictions": self.feed.mirroring.contradictions,
            **self._added_counters(),
        }

    def _age_s(self, state: State) -> float:
        return min(self.feed.age_s(state), _MAX_AGE_S)

    # --- what a client has seen already

    def check_floor(self, instance: str, seq: int) -> None:
        """Check that a read sees a commit.

        Raises:
            ServerBusy: It has not come here yet.
        """
        state = self.feed.state
        if not instance or state.has(instance, seq):
            return
        if instance != state.instance:
            # An instance of the past makes no more commits, and its tree was replaced by a later
            # one.
            if instance in self._past:
                return
            self._ask_whether_past(instance)
        raise ServerBusy(
            f"the replica has not received commit {seq} of server instance {quoted(instance)}, "
            f"which this client has seen: it has {state.seq} of {state.instance}",
            limit=seq,
            value=state.seq,
            retry_after_s=_SOON_S if self._age_s(state) < _YOUNG_S else _LATER_S,
        )

    def _ask_whether_past(self, instance: str) -> None:
        """Find out whether an instance is gone. One that a client has seen is, if the primary that
        answers after that is another one."""
        if not self._is_asking:
            self._is_asking = True
            threads.start("past instance", self._ask_primary, instance)

    def _ask_primary(self, instance: str) -> None:
        try:
            hello = wire.call_body("hello") | wire.floor_field(instance, 0)
            reply = run(self._source.ask("hello", hello, 0.0), self._source.take)
            if wire.text(reply, "instance") != instance:
                self._add_past(instance)
        except TransformException:  # it is away: the client asks again
            time.sleep(_LATER_S)
        finally:
            self._is_asking = False

    def _add_past(self, instance: str) -> None:
        if instance not in self._past and instance != self.instance:
            self._past.append(instance)
