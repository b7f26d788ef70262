"""What a client and the server of its tree say to each other, without any I/O.

Each method is a generator of steps: it yields what to do next, is sent the outcome, and returns
its result. `Connection` runs the steps with blocking calls, `aio.Connection` on an event loop.

Thread safety: all methods; steps of different threads run side by side.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, TypeGuard, TypeVar

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf._net.queries import NoReply
from zenoh_tf.errors import (
    OutcomeUnknown,
    ServerRestarted,
    ServerUnavailable,
    TransformException,
)

from ..requests import info
from ..requests.request import Request
from . import retries
from .access import Access
from .seen_states import SeenStates
from .server_info import Replica, ServerInfo, parse_server_info
from .steps import Ask, Pause, ReadQuery, Steps, decode

T = TypeVar("T")

#: A client that makes calls says hello again this often: clocks drift apart, and the server
#: measures them.
_CLOCK_PERIOD_S: Final = 10.0
#: The second time comes sooner, as it is the first that can measure a round trip.
_FIRST_CLOCK_PERIOD_S: Final = 1.0
#: How much longer a call may take for it: Zenoh may never end one sent as the server ends.
_HELLO_TIMEOUT_S: Final = 0.5
#: A client that knows no server looks for a replica for this share of a read's time.
_FIND_SHARE: Final = 0.25
#: A replica that lacks what the client must see is asked again after these pauses: a commit gets
#: there about as soon as its reply gets to the client. Then the server is asked.
_CATCH_UP_S: Final = (0.002, 0.008, 0.03)


class Exchange:
    """The exchange of one client with the server of one tree."""

    def __init__(self, tree: str, address: str, user: str | None, timeout_s: float) -> None:
        """`address`: where the server is, for messages.

        Raises:
            InvalidArgumentException: `tree` is no name of a tree.
        """
        self._tree = tree
        self._address = address
        self._user = user
        self.timeout_s = timeout_s
        self._timeout_ns = int(timeout_s * 1e9)
        self.keys = {name: zenoh.KeyExpr(keys.request(tree, name)) for name in keys.REQUEST_TYPES}
        #: The id by which the server distinguishes clients; known once the session is open.
        self.client_id: str | None = None
        #: The server that answered last; None if that is not known, or it may have gone.
        self.server: ServerInfo | None = None
        #: The id of the router that the client sits on; the connection knows it.
        self.router: Callable[[], str | None] = lambda: None
        self.absence = retries.Absence(self)
        #: What answers reads in place of the server; None if there is none.
        self.replica: Replica | None = None
        #: A replica has been there, so a read may be older than what another client has seen.
        self.reads_may_be_old = False
        #: How old the last reply may be, in seconds; None if it was the server's own.
        self.replica_age_s: float | None = None
        #: What this client has seen of the server.
        self.seen = SeenStates()
        self._next_greeting_s = 0.0  # of the replica
        #: What this client may do; None if the server has no access rules.
        self.access: Access | None = None
        #: Of the last hello that was answered: how long it took, and the clock in it.
        self._round_trip: tuple[int, int] | None = None
        self.next_hello_s = 0.0
        self._id_prefix = os.urandom(8)  # of a request id, followed by a count
        self._id_count = itertools.count()

    def hello(self, timeout_s: float | None = None) -> Steps[ServerInfo]:
        """Ask the server who it is, for its limits, and for what this client may do.

        Raises ServerUnavailable if it does not answer within `timeout_s`, or the usual time-out.
        """
        self.next_hello_s = time.monotonic() + self._clock_period_s()
        clock_ns = time.time_ns()
        request = self._hello_request(clock_ns)
        begin_ns = time.monotonic_ns()
        payload = wire.pack(request.body())
        reply = decode((yield Ask(self.keys["hello"], payload, timeout_s or self.timeout_s)))
        self.check_instance(reply)
        now_ns = time.monotonic_ns()
        if isinstance(reply, NoReply):
            if self.replica is None:
                raise ServerUnavailable(reply.reason)
            raise ServerUnavailable(
                f"the primary of tree {self._tree!r} does not answer: writes fail until it is "
                f"back; the replica at {self._address} answers reads"
            )
        self._round_trip = now_ns - begin_ns, clock_ns
        value = request.parse(reply)
        if self.replica is None:  # which has the rules for its clients
            self._take_access(value)
        server = parse_server_info(value, now_ns)
        self.server = server
        self.absence.ended()
        return server

    def greet(self, timeout_s: float | None = None) -> Steps[ServerInfo]:
        """Ask who answers reads: the replica at the client's router, or else the server.

        Raises ServerUnavailable if neither answers within `timeout_s`, or the usual time-out.
        """
        timeout_s = timeout_s or self.timeout_s
        deadline_s = time.monotonic() + timeout_s
        replica = yield from self._find_replica(timeout_s)
        if replica is not None:
            return replica.server
        return (yield from self.hello(max(deadline_s - time.monotonic(), 0.1)))

    def _find_replica(self, timeout_s: float) -> Steps[Replica | None]:
        """Look for the replica at the client's router, which may be another one than before."""
        router = self.router()
        found = None
        if router is not None:
            self._next_greeting_s = time.monotonic() + self._clock_period_s()
            near = {
                name: zenoh.KeyExpr(keys.replica_request(self._tree, router, name))
                for name in keys.REPLICA_REQUEST_TYPES
            }
            request = self._hello_request(time.time_ns())
            # Zenoh ends the query at once if nobody has this key.
            reply = decode((yield Ask(near["hello"], wire.pack(request.body()), timeout_s)))
            if not isinstance(reply, NoReply) and "error" not in reply:
                value = request.parse(reply)
                self.reads_may_be_old = True
                self._take_access(value)
                found = Replica(near, parse_server_info(value, time.monotonic_ns()))
        if found is not None and (self.replica is None or self.replica.keys != found.keys):
            self.seen.await_replica()  # it may be new, and older than the one before
        self.replica = found
        return found

    def _take_access(self, value: dict[str, Any]) -> None:
        """Accept what a server or replica says that this client may do."""
        access = value.get("access")
        self.access = (
            None if access is None else Access(self._tree, self._address, self._user, access)
        )

    def _hello_request(self, clock_ns: int) -> Request[dict[str, Any]]:
        return info.hello(self._user, self.client_id, clock_ns, self._round_trip)

    def _clock_period_s(self) -> float:
        return _FIRST_CLOCK_PERIOD_S if self._round_trip is None else _CLOCK_PERIOD_S

    def call(self, request: Request[T]) -> Steps[T]:
        """Send a request; return its result, or raise its error.

        Raises ServerUnavailable if no reply comes to a request that changes nothing, and
        OutcomeUnknown for a write, which the server applies at most once.
        """
        return self._write(request) if request.writes else self._read(request)

    def _read(self, request: Request[T]) -> Steps[T]:
        timeout_s = self.timeout_s + request.wait_s
        deadline_s = time.monotonic() + timeout_s
        replica_refusal: wire.Message | None = None
        if self.server is None or self.replica is not None:  # not the common case
            found = yield from self._try_replica(request, deadline_s)
            if found is not None and not wire.is_behind(found):
                wire.raise_error(found)
                return request.parse(found)
            replica_refusal = found
            timeout_s = max(deadline_s - time.monotonic(), 0.001)
        seen = self.seen.least
        if self.access is None and not self.reads_may_be_old:  # the common case
            key, payload = self.keys[request.request_type], request.payload()
        else:
            body = request.body()
            key = self._key(request.request_type, body)
            payload = wire.pack(body | {wire.WITH_SEQ: True} if self.reads_may_be_old else body)
        query = ReadQuery(
            key, self._check_size(payload), timeout_s, deadline_s, replica_refusal, seen
        )
        return (yield from self.finish_read(request, query, (yield query)))

    def finish_read(
        self, request: Request[T], query: ReadQuery, reply: bytes | NoReply
    ) -> Steps[T]:
        """Continue after the reply to the query of a read."""
        if (server := self.server) is not None and type(reply) is bytes:
            plain = request.parse_plain(reply, server.instance)
            if plain is not None:  # the common case
                self.replica_age_s = None
                yield from self._keep_in_touch()
                return plain[0]
        message = decode(reply)
        if not self.is_served(message):
            key, payload = query.key, query.payload
            give_up_s = min(time.monotonic() + retries.ABSENT_S, query.deadline_s)
            while True:
                message = yield from retries.while_busy(
                    self, message, key, payload, query.deadline_s
                )
                if not isinstance(message, NoReply):
                    break
                if query.replica_refusal is not None:
                    wire.raise_error(query.replica_refusal)
                if message.at_once:
                    yield from self._check_new_rules(request)
                if not message.at_once or not self.absence.may_end(give_up_s):
                    raise ServerUnavailable(message.reason)
                yield Pause(retries.PAUSE_S)
                left_s = query.deadline_s - time.monotonic()
                message = decode((yield Ask(key, payload, max(left_s, 0.001))))
        self.replica_age_s = None
        if self.reads_may_be_old and type(message.get("seq")) is int:
            self.seen.record_server(wire.text(message, "instance"), message["seq"], query.seen)
            if self.replica is not None:
                self.seen.await_replica()
        yield from self._keep_in_touch()
        wire.raise_error(message)
        return request.parse(message)

    def _keep_in_touch(self) -> Steps[None]:
        """Say hello again if it is time for it, after a read that was answered."""
        if time.monotonic() < self.next_hello_s:
            return
        with contextlib.suppress(TransformException):
            yield from self.hello(_HELLO_TIMEOUT_S)
            if self.replica is None:  # one may have come
                yield from self._find_replica(_HELLO_TIMEOUT_S)

    def _try_replica(self, request: Request[Any], deadline_s: float) -> Steps[wire.Message | None]:
        """Find out what answers reads if that is not known; return the reply of the replica, if it
        is one. None: the server is to be asked."""
        if self.server is None and self.replica is None:  # it has gone, or changed
            with contextlib.suppress(TransformException):
                yield from self.greet(self.timeout_s * _FIND_SHARE)
        if (replica := self.replica) is None or request.request_type not in replica.keys:
            return None
        found = yield from self._ask_replica(replica, request, deadline_s)
        if not isinstance(found, NoReply):
            return found
        if not found.at_once:
            raise ServerUnavailable(found.reason)
        return None

    def _ask_replica(
        self, replica: Replica, request: Request[Any], deadline_s: float
    ) -> Steps[wire.Message | NoReply]:
        """Ask the replica; its refusal is the outcome if it does not get what the client must
        see soon."""
        awaited, least = self.seen.awaited, self.seen.least  # in this order
        body = request.body()
        if least is not None:
            body = body | wire.least(least.instance, least.seq)
        payload = self._check_size(wire.pack(body))
        pauses = iter(_CATCH_UP_S)
        while True:
            left_s = max(deadline_s - time.monotonic(), 0.001)
            key = replica.keys[request.request_type]
            reply = decode((yield Ask(key, payload, left_s)))
            reply = yield from retries.while_busy(self, reply, key, payload, deadline_s)
            if isinstance(reply, NoReply):
                self.replica = None
                return reply
            pause_s = next(pauses, None) if wire.is_behind(reply) else None
            if pause_s is None:
                break
            yield Pause(pause_s)
        if awaited is not None and not wire.is_behind(reply):
            self.seen.caught_up(awaited)
        instance = reply.get("instance")
        state = wire.parse_replica(reply)
        self.replica_age_s = None if state is None else state[1] / 1e9
        if state and self.seen.is_news(instance, state[2]) and not wire.is_behind(reply):
            self.seen.record_read(wire.text(reply, "instance"), state[2])
        if type(instance) is str and instance != replica.server.instance:  # it follows another one
            self.replica = replace(replica, server=replace(replica.server, instance=instance))
        if time.monotonic() >= self._next_greeting_s:
            with contextlib.suppress(TransformException):  # the read itself was answered
                yield from self._find_replica(_HELLO_TIMEOUT_S)
        return reply

    def _write(self, request: Request[T]) -> Steps[T]:
        """If the request names an instance, only that server instance may apply the write; another
        one answers ServerRestarted."""
        try:
            reply = yield from self._write_once(request)
        except ServerRestarted:
            # The new server rejected it, so it was not applied and may be sent again.
            self.server = None
            if request.instance is not None:
                raise
            reply = yield from self._write_once(request)
        return request.parse(reply)

    def _write_once(self, request: Request[Any]) -> Steps[wire.Message]:
        server = self.server
        if server is None or time.monotonic() >= self.next_hello_s:
            server = yield from retries.hello(self)  # for an expiry by the clocks as they are now
        body = request.body()
        key = self._key(request.request_type, body)
        now_ns = time.monotonic_ns()
        write = wire.write_fields(
            self._id_prefix + next(self._id_count).to_bytes(8, "big"),
            now_ns + server.clock_offset_ns + self._timeout_ns,
            request.instance or server.instance,
        )
        payload = server.check_size(wire.pack(body | write))
        reply = decode((yield Ask(key, payload, self.timeout_s)))
        if not self.is_served(reply):
            # A refused write did not run, so it may be sent again; its expiry stays the same.
            deadline_s = now_ns * 1e-9 + self.timeout_s
            reply = yield from retries.while_busy(self, reply, key, payload, deadline_s)
            if isinstance(reply, NoReply):
                if reply.at_once:
                    yield from self._check_denied(request, server.instance)
                raise OutcomeUnknown(f"{reply.reason}: the write may or may not have been applied")
        self.seen.record_write(reply)
        if self.replica is not None:
            self.seen.await_replica()
        if "error" in reply:
            wire.raise_error(reply)
        return reply

    def _key(self, request_type: str, body: wire.Message) -> zenoh.KeyExpr:
        """The key of a request. Raises AccessDenied if the server's rules do not allow it."""
        access = self.access
        if access is None:
            return self.keys[request_type]
        return zenoh.KeyExpr(access.key(request_type, body))

    def _check_new_rules(self, request: Request[Any]) -> Steps[None]:
        """Raise AccessDenied if the server was restarted with rules that do not allow a request.

        Zenoh gives no reply to a request that is denied, as if no server were there.
        """
        if self.server is None:
            with contextlib.suppress(ServerUnavailable):
                yield from self.hello(_HELLO_TIMEOUT_S)
                self._key(request.request_type, request.body())

    def _check_denied(self, request: Request[Any], instance: str) -> Steps[None]:
        """Raise AccessDenied if the rules of a server instance, which never change, do not allow
        a write that got no reply: then it has not run."""
        if self.replica is not None:  # its rules may be others than this client knows
            yield from self._find_replica(_HELLO_TIMEOUT_S)
        with contextlib.suppress(ServerUnavailable):
            server = yield from self.hello(_HELLO_TIMEOUT_S)
            if server.instance == (request.instance or instance):
                self._key(request.request_type, request.body())

    def is_served(self, reply: wire.Message | NoReply) -> TypeGuard[wire.Message]:
        """The common case: the known server has served the request."""
        server = self.server
        return (
            type(reply) is dict
            and "error" not in reply
            and server is not None
            and reply.get("instance") == server.instance
        )

    def check_instance(self, reply: wire.Message | NoReply) -> None:
        """Forget the server if another one replied, or none."""
        server = self.server
        if server is not None and (
            isinstance(reply, NoReply) or reply.get("instance") != server.instance
        ):
            self.server = None  # the clock and limits of a new one are not known yet

    def _check_size(self, payload: bytes) -> bytes:
        """Return a request's bytes. Raises LimitExceeded if the server takes no such long ones."""
        server = self.server
        return payload if server is None else server.check_size(payload)
