"""What a client and the server of its tree say to each other.

It is written as generators of steps: each yields what to do next, is sent the outcome, and returns
its result. `Exchange.call` takes the steps with blocking calls, `aio` on an event loop.

Thread safety: all methods; steps of different threads run side by side.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import threading
import time
import weakref
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeGuard, TypeVar

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf._net.queries import NoReply, Queries
from zenoh_tf.errors import (
    OutcomeUnknown,
    ServerRestarted,
    ServerUnavailable,
    TransformException,
)
from zenoh_tf.shared_tree import AskServer
from zenoh_tf.steps import Ask, Pause, Steps, decode, run

from ..requests import info
from ..requests.receipt import Receipt, later
from ..requests.request import Request
from . import retries
from .access import Access
from .floor import Floor
from .server_info import ServerInfo, parse_server_info

T = TypeVar("T")

#: A client that makes calls says hello again this often: clocks drift apart, and the server
#: measures them.
_CLOCK_PERIOD_S: Final = 10.0
#: The second time comes sooner, as it is the first that can measure a round trip.
_FIRST_CLOCK_PERIOD_S: Final = 1.0
#: How much longer a call may take for it: Zenoh may never end one sent as the server ends.
_HELLO_TIMEOUT_S: Final = 0.5


@dataclass(slots=True)
class JudgedQuery(Ask):
    """A query to the server, with what its reply is judged by."""

    deadline_s: float
    floor: Receipt | None = None  # of the client, if the query names it


class ServerUser(Protocol):
    """What has something of the server, such as its memory."""

    def server_changed(self) -> None:
        """Called when another server may answer by now, or none. Must not raise or block."""


class Exchange:
    """The exchange of one client with the server of one tree."""

    #: The queries of the session, which may be another one at any time.
    queries: Queries

    def __init__(
        self, tree: str, address: str, user: str | None, timeout_s: float, *, moves: bool = False
    ) -> None:
        """`address`: where the server is, for messages. `moves`: the connection has several
        endpoints, and soon another link if it loses one.

        Raises:
            InvalidArgumentException: `tree` is no name of a tree.
        """
        self.tree = tree
        self._address = address  # for messages: without secrets
        self._user = user
        self.timeout_s = timeout_s
        self._timeout_ns = int(timeout_s * 1e9)
        self.keys = {name: zenoh.KeyExpr(keys.request(tree, name)) for name in keys.REQUEST_TYPES}
        #: The id by which the server distinguishes clients; known once the session is open.
        self.client_id: str | None = None
        #: The server that answered last; None if that is not known, or it may have gone.
        self.server: ServerInfo | None = None
        self._server_users: weakref.WeakSet[ServerUser] = weakref.WeakSet()
        #: How many requests were sent by the reason why the server's memory had no answer; None:
        #: no memory has it. Without a lock, as a forked child may inherit one locked. A lost count
        #: does no harm.
        self.asked: dict[AskServer | None, int] = dict.fromkeys((None, *AskServer), 0)
        self.absence = retries.Absence(self)
        self.moves = moves
        #: How old the last answer may be, in seconds; None if the server that commits gave it.
        self.age_s: float | None = None
        #: What requests must see, if the client moves.
        self.floor = Floor()
        #: Of the latest write that the server has replied to.
        self.last_receipt: Receipt | None = None
        #: What this client may do; None if the server has no access rules.
        self.access: Access | None = None
        #: Of the last hello that was answered: how long it took, and the clock in it.
        self._round_trip: tuple[int, int] | None = None
        self.next_hello_s = 0.0
        self._id_prefix = os.urandom(8)  # of a request id, followed by a count
        self._id_count = itertools.count()
        self._is_closed = threading.Event()

    # --- with blocking calls

    def call(self, request: Request[T], why: Any = None) -> T:
        """Send a request; return its result, or raise its error, as `steps`. `why`: it is a lookup
        to which the server's memory had no answer."""
        self.asked[why] += 1
        if why is AskServer.LAPSED:
            self.report_server()
        if request.writes:
            server = self.server
            if server is None or time.monotonic() >= self.next_hello_s:
                return self.run(self._write(request))
            query = self._write_query(request, server)
            reply = self.take(query)
            served = self._served(reply)
            if served is not None:
                return request.parse(served)
            return self.run(self._finish_write(request, query, reply, server))
        # The common case is a query and its reply. Steps would add a half to its work.
        query = self._query(request)
        reply = self.take(query)
        found = self._plain(request, reply)
        if found is not None:
            return found[0]
        return self.run(self._finish_read(request, query, reply))

    def run(self, routine: Steps[T]) -> T:
        """Take the steps of a routine, and return its result."""
        return run(routine, self.take)

    def take(self, step: Ask | Pause) -> bytes | NoReply | None:
        """Take a step, and return its outcome."""
        if isinstance(step, Pause):
            time.sleep(step.seconds)
            return None
        queries = self.queries
        try:
            return queries.ask(step.key, step.payload, step.timeout_s)
        except ServerUnavailable:
            if not self.was_replaced(queries):
                raise
            return queries.went_away()

    def greet_at(self, queries: Queries, timeout_s: float) -> None:
        """As `greet`, by the queries of a session that may become this connection's."""

        def take(step: Ask | Pause) -> bytes | NoReply:
            assert isinstance(step, Ask)
            return queries.ask(step.key, step.payload, step.timeout_s)

        run(self.greet(timeout_s), take)

    @property
    def closed(self) -> bool:
        """True once the connection is closed."""
        return self._is_closed.is_set()

    def was_replaced(self, queries: Queries) -> bool:
        """Whether a query failed because the connection has another session by now."""
        return queries is not self.queries and not self.closed

    def router(self) -> str | None:
        """The id of the router that the session is connected to; None if to none now. Raises
        ServerUnavailable if it is closed."""
        return None

    def add_server_user(self, user: ServerUser) -> None:
        """Report to a user, unless it is collected, when the server may have changed."""
        self._server_users.add(user)

    def report_server(self) -> None:
        """The server may have changed, or ended."""
        for user in list(self._server_users):
            user.server_changed()

    # --- as steps

    def greet(self, timeout_s: float | None = None) -> Steps[ServerInfo]:
        """Ask the server who it is, for its limits, and for what this client may do.

        Raises ServerUnavailable if it does not answer within `timeout_s`, or the usual time-out.
        """
        self.next_hello_s = time.monotonic() + self._clock_period_s()
        clock_ns = time.time_ns()
        request = info.hello(self._user, self.client_id, clock_ns, self._round_trip)
        begin_ns = time.monotonic_ns()
        payload = wire.pack(request.body())
        reply = decode((yield Ask(self.keys["hello"], payload, timeout_s or self.timeout_s)))
        self.check_instance(reply)
        now_ns = time.monotonic_ns()
        if isinstance(reply, NoReply):
            raise ServerUnavailable(reply.reason)
        self._round_trip = now_ns - begin_ns, clock_ns
        value = request.parse(reply)
        access = value.get("access")
        self.access = (
            None if access is None else Access(self.tree, self._address, self._user, access)
        )
        known, server = self.server, parse_server_info(value, now_ns)
        self.server = server
        self.absence.ended()
        if known is None or known.instance != server.instance:
            self.report_server()
        return server

    def _clock_period_s(self) -> float:
        return _FIRST_CLOCK_PERIOD_S if self._round_trip is None else _CLOCK_PERIOD_S

    def steps(self, request: Request[T]) -> Steps[T]:
        """Send a request; return its result, or raise its error.

        Raises ServerUnavailable if no reply comes to a request that changes nothing, and
        OutcomeUnknown for a write, which the server applies at most once.
        """
        return self._write(request) if request.writes else self._read(request)

    def _read(self, request: Request[T]) -> Steps[T]:
        query = self._query(request)
        reply = yield query
        found = self._plain(request, reply)
        if found is not None:
            return found[0]
        return (yield from self._finish_read(request, query, reply))

    def _query(self, request: Request[Any]) -> JudgedQuery:
        """The query of a read."""
        timeout_s = self.timeout_s + request.wait_s
        floor: Receipt | None = None
        if self.access is None and not self.moves:  # the common case
            key, payload = self.keys[request.request_type], request.payload()
        else:
            body = request.body()
            key = self._key(request.request_type, body)
            if self.moves:
                floor = None if wire.FLOOR in body else self.floor.value
                body = self.floor.add(body)
            payload = wire.pack(body)
        server = self.server
        if server is not None and len(payload) > server.message_bytes:
            raise server.too_long(len(payload))
        return JudgedQuery(key, payload, timeout_s, time.monotonic() + timeout_s, floor)

    def _plain(self, request: Request[T], reply: bytes | NoReply | None) -> tuple[T] | None:
        """The result of a read in the common case. None: the reply has to be decoded, or is not
        from the server that is known, or that one is to be greeted."""
        server = self.server
        if server is None or type(reply) is not bytes or time.monotonic() >= self.next_hello_s:
            return None
        found = request.parse_plain(reply, server.instance)
        if found is not None:
            self.age_s = None
        return found

    def _finish_read(
        self, request: Request[T], query: JudgedQuery, reply: bytes | NoReply | None
    ) -> Steps[T]:
        """Continue after the reply to the query of a read, if it is not plain."""
        assert reply is not None
        message = decode(reply)
        if not self.is_served(message):
            key, payload = query.key, query.payload
            give_up_s = query.deadline_s
            if not self.moves:
                give_up_s = min(time.monotonic() + retries.ABSENT_S, give_up_s)
            while True:
                message = yield from retries.while_busy(
                    self, message, key, payload, query.deadline_s
                )
                if not isinstance(message, NoReply):
                    break
                if message.at_once:
                    yield from self._check_new_rules(request)
                if not message.at_once or not self.absence.may_end(give_up_s):
                    raise ServerUnavailable(message.reason)
                yield Pause(retries.PAUSE_S)
                left_s = query.deadline_s - time.monotonic()
                message = decode((yield Ask(key, payload, max(left_s, 0.001))))
        self.age_s = wire.parse_age_s(message)
        self.floor.record(message, query.floor)
        if self.server is None:
            self.report_server()
        yield from self._keep_in_touch()
        wire.raise_error(message)
        return request.parse(message)

    def _keep_in_touch(self) -> Steps[None]:
        """Say hello again if it is time for it, after a read that was answered."""
        if time.monotonic() < self.next_hello_s:
            return
        with contextlib.suppress(TransformException):
            yield from self.greet(_HELLO_TIMEOUT_S)

    def _write(self, request: Request[T], *, again: bool = True) -> Steps[T]:
        """If the request names an instance, only that server instance may apply the write; another
        one answers ServerRestarted."""
        server = self.server
        if server is None or time.monotonic() >= self.next_hello_s:
            server = yield from retries.greet(self)  # for an expiry by the clocks as they are now
        query = self._write_query(request, server)
        reply = yield query
        served = self._served(reply)
        if served is not None:
            return request.parse(served)
        return (yield from self._finish_write(request, query, reply, server, again=again))

    def _write_query(self, request: Request[Any], server: ServerInfo) -> JudgedQuery:
        """The query of a write."""
        body = request.body()
        key = self._key(request.request_type, body) if self.access else None
        now_ns = time.monotonic_ns()
        write = wire.write_fields(
            self._id_prefix + next(self._id_count).to_bytes(8, "big"),
            now_ns + server.clock_offset_ns + self._timeout_ns,
            request.instance or server.instance,
        )
        if self.moves:
            write = self.floor.add(write)
        payload = wire.pack(body | write)
        if len(payload) > server.message_bytes:
            raise server.too_long(len(payload))
        return JudgedQuery(
            key or self.keys[request.request_type],
            payload,
            self.timeout_s,
            now_ns * 1e-9 + self.timeout_s,
            self.floor.value,
        )

    def _served(self, reply: bytes | NoReply | None) -> wire.Message | None:
        """The reply to a write in the common case. None: it is an error, or not from the server
        that is known."""
        if type(reply) is not bytes or self.moves:
            return None
        message = wire.unpack(reply, wire.MAX_REPLY_BYTES)
        if not self.is_served(message):
            return None
        self.last_receipt = later(self.last_receipt, message)
        return message

    def _finish_write(
        self,
        request: Request[T],
        query: JudgedQuery,
        outcome: bytes | NoReply | None,
        server: ServerInfo,
        *,
        again: bool = True,
    ) -> Steps[T]:
        """Continue after the reply to the query of a write. A server that refuses it as meant for
        another one has not applied it, so it is sent to that one, unless it names an instance."""
        assert outcome is not None
        # A refused write did not run, so it may be sent again; its expiry stays the same.
        reply = yield from retries.while_busy(
            self, decode(outcome), query.key, query.payload, query.deadline_s, writes=True
        )
        if isinstance(reply, NoReply):
            if reply.at_once:
                yield from self._check_denied(request, server.instance)
            raise OutcomeUnknown(f"{reply.reason}: the write may or may not have been applied")
        self.floor.record(reply, query.floor)
        self.last_receipt = later(self.last_receipt, reply)
        try:
            wire.raise_error(reply)
        except ServerRestarted:
            self.server = None
            if request.instance is not None or not again:
                raise
            return (yield from self._write(request, again=False))
        return request.parse(reply)

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
                yield from self.greet(_HELLO_TIMEOUT_S)
                self._key(request.request_type, request.body())

    def _check_denied(self, request: Request[Any], instance: str) -> Steps[None]:
        """Raise AccessDenied if the rules of a server instance, which never change, do not allow
        a write that got no reply: then it has not run."""
        with contextlib.suppress(ServerUnavailable):
            server = yield from self.greet(_HELLO_TIMEOUT_S)
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
