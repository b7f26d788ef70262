"""The service of a replica: a `Service` for each copy of the primary's tree, one after another.

A request is served by the copy that is complete when it comes, and its reply says how old that is.
While a new copy is made, the last one answers. The instance in replies is the primary's, because
the versions are: a transaction may read here and commit there.

Thread safety: all methods.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final, NoReturn

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException, ReplicaBehind, ServerUnavailable
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.mirrors.source import Source, State
from zenoh_tf.text import quoted

from ..limits import Limits
from ..requests.guard import RequestGuard
from ..requests.handler import Handler, ReplyCallback, ReplyWithField
from ..requests.service import Service
from .copies import SharedCopies

#: Time-out of the first copy.
_COPY_TIMEOUT_S: Final = 30.0
#: Lookups that wait in a copy that was replaced end after this time, and are asked again.
_REPLACED_S: Final = 0.5
#: As many instances of the primary are remembered.
_MAX_PAST: Final = 16
#: In place of an age that is not known.
_MAX_AGE_S: Final = 1e9


class ReplicaService(Handler):
    """Serves reads from copies of a tree."""

    def __init__(
        self,
        name: str,
        own_id: str,
        limits: Limits,
        loop: asyncio.AbstractEventLoop,
        copies: SharedCopies,
        source: Source,
    ) -> None:
        """Follow the primary, `source`. `own_id`: what `hello` calls this replica. `copies` makes
        the trees."""
        super().__init__(name, limits, RequestGuard())
        #: What the clients may do, as the reply to `hello` says it; None: everything.
        self.access: Callable[[], dict[str, Any] | None] = lambda: None
        #: Whether a client's token is there.
        self.is_connected: Callable[[str], bool] = lambda client: True
        self._own_id = own_id
        self._copies = copies
        self._loop = loop
        #: By copy; besides the current one, the one before it for a moment.
        self._services: dict[TransformTree, Service] = {}
        self._past: deque[str] = deque(maxlen=_MAX_PAST)  # instances that are gone
        self._feed = MirrorFeed(source, self._take, make_tree=copies.make_tree)  # last: it calls

    def wait_for_copy(self) -> None:
        """Wait for the first copy.

        Raises:
            TransformException: There is none in time.
        """
        self._feed.wait_for_copy(_COPY_TIMEOUT_S)

    def close(self) -> None:
        """Follow the primary no more, and answer what waits."""
        self._feed.close()
        self._copies.close()
        for service in list(self._services.values()):
            service.close()

    @property
    def state(self) -> State:
        """What is served."""
        return self._feed.state

    @property
    def instance(self) -> str:
        """The primary's instance whose state is served."""
        return self.state.instance

    @property
    def age_s(self) -> float:
        """How old what is served may be, in seconds."""
        return self._age_s(self.state)

    def handle(
        self, request_type: str, payload: bytes, reply_to: ReplyCallback, chunk: str | None = None
    ) -> None:
        state = self.state  # before the read, which may see more
        service = None if state.tree is None else self._services.get(state.tree)
        if service is None:
            reply_to(self.error(ServerUnavailable("the replica is stopping")), True)
        else:
            dated = ReplyWithField(reply_to, wire.REPLICA, lambda: self._freshness(state))
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

    # --- copies

    def _take(self, tree: TransformTree | None, instance: str) -> None:
        """Serve a new copy, which `state` has right after this."""
        if tree is None:
            return
        service = _CopyService(self, tree, instance)
        service.requests = self.requests
        # Another function may be set later.
        service.waiters.is_connected = lambda client: self.is_connected(client)  # noqa: PLW0108
        service.add_counters(self._counters)
        self.clocks, self.info_requests = service.clocks, service.info_requests
        # From here on no client reads the copy before this one in memory.
        service.offer = self._copies.share(tree, self.limits)
        replaced = dict(self._services)
        self._services[tree] = service
        if replaced:
            threads.start("replaced copy", self._end, replaced, instance)

    def _end(self, replaced: dict[TransformTree, Service], instance: str) -> None:
        time.sleep(_REPLACED_S)
        for tree, service in replaced.items():
            if service.instance not in (instance, *self._past):
                self._past.append(service.instance)
            self._services.pop(tree, None)
            service.close()

    def _counters(self) -> dict[str, Any]:
        return {
            "replica_age_s": self.age_s,
            "replica_seq": self.state.seq,
            "replica_snapshots": self._feed.snapshots,
            "replica_contradictions": self._feed.mirroring.contradictions,
            **self._added_counters(),
        }

    def _age_s(self, state: State) -> float:
        return min(self._feed.age_s(state), _MAX_AGE_S)

    def _freshness(self, state: State) -> dict[str, int]:
        """What the reply to a read that began in `state` says of it: which commits it has seen, how
        old it is, and the last commit that it may have seen in part (`wire/replica.py`)."""
        reach = max(state.seq, self._feed.mirroring.reach_seq)
        return {"seq": state.seq, "reach": reach, "age_ns": int(self._age_s(state) * 1e9)}

    def check_least(self, tree: TransformTree, instance: str, seq: int) -> None:
        """Check that a read in a copy sees a commit.

        Raises:
            ReplicaBehind: It has not received that commit yet.
        """
        state = self.state
        # A primary of the past makes no more commits, and its copy was replaced by a later tree.
        if (state.tree is tree and state.has(instance, seq)) or instance in self._past:
            return
        raise ReplicaBehind(
            f"the replica has not received commit {seq} of server instance {quoted(instance)}, "
            f"which this client must see: it has {state.seq} of {state.instance}",
            limit=seq,
            value=state.seq,
        )


class _CopyService(Service):
    """The service of one copy: it accepts no writes."""

    def __init__(self, replica: ReplicaService, tree: TransformTree, instance: str) -> None:
        name, limits, guard = replica.name, replica.limits, _Guard(replica, tree)
        super().__init__(tree, name, instance, limits, replica._loop, guard=guard)
        self._identity["replica"] = replica._own_id

    def _store(self, commit: wire.Commit) -> NoReturn:
        raise InvalidArgumentException(
            f"this is a replica, which accepts no writes: send them to the key of tree "
            f"{self.name!r} itself, not to that of its replica",
            field="request_type",
        )


class _Guard(RequestGuard):
    """Refuses reads that must see more than there is."""

    def __init__(self, replica: ReplicaService, tree: TransformTree) -> None:
        super().__init__()
        self.checked = frozenset(keys.REQUEST_TYPES)
        self._replica = replica
        self._tree = tree

    def access(self, message: wire.Message) -> dict[str, Any] | None:
        """The same for every client: what the primary allows to the replica's user."""
        return self._replica.access()

    def check(self, request_type: str, chunk: str | None, message: wire.Message) -> None:
        """Check that a read sees what it must see at least. Removes the fields that say it."""
        if wire.LEAST_SEQ in message:
            instance = wire.text(message, wire.LEAST_INSTANCE)
            seq = wire.integer(message, wire.LEAST_SEQ, low=0)
            del message[wire.LEAST_SEQ], message[wire.LEAST_INSTANCE]
            self._replica.check_least(self._tree, instance, seq)
