"""What a client and the server of its tree say to each other, without any I/O.

Each method is a generator of steps: it yields what to do next, is sent the outcome, and returns
its result. `Connection` takes the steps with blocking calls, `aio.Connection` on an event loop.

Thread safety: all methods; steps of different threads run side by side.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import threading
import time
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import zenoh

from zenoh_tf import handover, keys, wire
from zenoh_tf.errors import (
    LimitExceeded,
    OutcomeUnknown,
    ServerBusy,
    ServerRestarted,
    ServerUnavailable,
    TransformException,
)

from . import info_requests
from .access import Access
from .queries import NoReply
from .receipt import Receipt, later
from .request import Request

T = TypeVar("T")

#: A client that makes calls says hello again this often: clocks drift apart, and the server
#: measures them.
_CLOCK_PERIOD_S: Final = 10.0
#: The second time comes sooner, as it is the first that can tell a round trip.
_FIRST_CLOCK_PERIOD_S: Final = 1.0
#: How much longer a read may take for it.
_CLOCK_TIMEOUT_S: Final = 0.5
#: The limit of a server that does not tell.
_DEFAULT_ROWS: Final = 100_000


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """The server that answered last."""

    instance: str
    clock_ns: int  # the server's, when it replied
    clock_offset_ns: int  # the server's clock minus this one's, rounded down
    message_bytes: int
    rows: int  # transforms in one message
    offer: handover.Offer | None = None  # of its tree's memory


@dataclass(frozen=True, slots=True)
class Ask:
    """A step: send a query. Its outcome is the reply, or a `NoReply`."""

    key: zenoh.KeyExpr
    payload: bytes
    timeout_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """A step: wait. It has no outcome."""

    seconds: float


#: The steps to a result. An error of a step is raised where the generator yielded it.
Steps = Generator[Ask | Pause, Any, T]


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
        self._timeout_s = timeout_s
        self._keys = {name: zenoh.KeyExpr(keys.operation(tree, name)) for name in keys.OPERATIONS}
        #: What the server tells clients apart by; known once the session is open.
        self.client_id: str | None = None
        #: The server that answered last; None if it is not known, or may have been replaced.
        self.server: ServerInfo | None = None
        #: What this client may do; None if the server has no access rules.
        self.access: Access | None = None
        #: Of the latest write that the server has replied to.
        self.last_receipt: Receipt | None = None
        self._receipt_lock = threading.Lock()
        self._round_trip_ns: int | None = None  # of the last hello
        self._next_hello_s = 0.0
        # A request id: random per client, then counted.
        self._id_prefix = os.urandom(8)
        self._id_count = itertools.count()

    def hello(self, timeout_s: float | None = None) -> Steps[ServerInfo]:
        """Ask the server who it is, for its limits, and for what this client may do.

        Raises ServerUnavailable if it does not answer within `timeout_s`, or the usual time-out.
        """
        period_s = _FIRST_CLOCK_PERIOD_S if self._round_trip_ns is None else _CLOCK_PERIOD_S
        self._next_hello_s = time.monotonic() + period_s
        request = info_requests.hello(
            self._user, self.client_id, time.time_ns(), self._round_trip_ns
        )
        begin_ns = time.monotonic_ns()
        payload = wire.pack(request.body())
        if timeout_s is None:
            timeout_s = self._timeout_s
        reply = yield from self._query(self._keys["hello"], payload, timeout_s)
        if isinstance(reply, NoReply) and reply.at_once:
            # Servers before access rules answer `hello` among the infos only.
            reply = yield from self._query(self._keys["info"], payload, timeout_s)
        now_ns = time.monotonic_ns()
        if isinstance(reply, NoReply):
            raise ServerUnavailable(reply.reason)
        self._round_trip_ns = now_ns - begin_ns
        value = request.parse(reply)
        access = value.get("access")
        self.access = (
            None if access is None else Access(self._tree, self._address, self._user, access)
        )
        # The server read its clock before this side did, so the offset is too small by the
        # reply's travel time at most. An expiry computed with it is never later than this
        # side's own time-out.
        clock_ns = wire.integer(value, "clock_ns")
        server = ServerInfo(
            wire.text(value, "instance"),
            clock_ns,
            clock_ns - now_ns,
            wire.integer(value.get("limits", {}), "message_bytes", wire.MAX_MESSAGE_BYTES),
            wire.integer(value.get("limits", {}), "rows", _DEFAULT_ROWS),
            handover.parse_offer(value.get(handover.HELLO_FIELD)),
        )
        self.server = server
        return server

    def known_server(self) -> Steps[ServerInfo]:
        """Return the server that answered last; asks for it if none is known."""
        return self.server or (yield from self.hello())

    def call(self, request: Request[T]) -> Steps[T]:
        """Send a request; return its result, or raise its error.

        Raises ServerUnavailable if no reply comes to a request that changes nothing, and
        OutcomeUnknown for a write, which the server applies at most once.
        """
        if request.writes:
            reply = yield from self._write(request.kind, request.body(), request.instance)
        else:
            reply = yield from self._read(request.kind, request.body(), request.wait_s)
        return request.parse(reply)

    def _read(self, operation: str, body: wire.Message, wait_s: float) -> Steps[wire.Message]:
        key = self._key(operation, body)
        payload = self._pack(body)
        reply = yield from self._query_until_served(key, payload, self._timeout_s + wait_s)
        if isinstance(reply, NoReply):
            if reply.at_once:
                yield from self._check_new_rules(operation, body)
            raise ServerUnavailable(reply.reason)
        if time.monotonic() >= self._next_hello_s:
            with contextlib.suppress(TransformException):  # the read itself was answered
                yield from self.hello(_CLOCK_TIMEOUT_S)
        wire.raise_error(reply)
        return reply

    def _write(
        self, operation: str, body: wire.Message, instance: str | None
    ) -> Steps[wire.Message]:
        """With an `instance`, only that server instance may apply the write; another one answers
        ServerRestarted."""
        wanted = instance or (yield from self.known_server()).instance
        try:
            return (yield from self._write_once(operation, body, wanted))
        except ServerRestarted:
            # The new server rejected it, so it was not applied and may be sent again.
            self.server = None
            if instance is not None:
                raise
        wanted = (yield from self.known_server()).instance
        return (yield from self._write_once(operation, body, wanted))

    def _write_once(self, operation: str, body: wire.Message, instance: str) -> Steps[wire.Message]:
        server = yield from self.known_server()
        if time.monotonic() >= self._next_hello_s:
            server = yield from self.hello()  # for an expiry by the clocks as they are now
        key = self._key(operation, body)
        timeout_ns = int(self._timeout_s * 1e9)
        write = wire.Write(
            self._id_prefix + next(self._id_count).to_bytes(8, "big"),
            time.monotonic_ns() + server.clock_offset_ns + timeout_ns,
            instance,
        )
        payload = self._pack(body | write.fields())
        # A refused write did not run, so it may be sent again; its expiry stays the same.
        reply = yield from self._query_until_served(key, payload, self._timeout_s)
        if isinstance(reply, NoReply):
            raise OutcomeUnknown(f"{reply.reason}: the write may or may not have been applied")
        with self._receipt_lock:
            self.last_receipt = later(self.last_receipt, reply)
        wire.raise_error(reply)
        return reply

    def _key(self, operation: str, body: wire.Message) -> zenoh.KeyExpr:
        """The key of a request. Raises AccessDenied if the server's rules do not allow it."""
        access = self.access
        if access is None:
            return self._keys[operation]
        return zenoh.KeyExpr(access.key(operation, body))

    def _check_new_rules(self, operation: str, body: wire.Message) -> Steps[None]:
        """Raise AccessDenied if the server was restarted with rules that do not allow a request.

        Zenoh gives no reply to a request that is denied, as if no server were there.
        """
        if self.server is None:
            with contextlib.suppress(ServerUnavailable):
                yield from self.hello()
                self._key(operation, body)

    def _query_until_served(
        self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float
    ) -> Steps[wire.Message | NoReply]:
        """As `_query`, and again as long as the server is busy and the time is not over."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            reply = yield from self._query(key, payload, timeout_s)
            if isinstance(reply, NoReply) or "error" not in reply:
                return reply
            error = wire.decode_error(reply["error"])
            pause_s = error.retry_after_s
            if not isinstance(error, ServerBusy) or pause_s is None or pause_s < 0:
                return reply
            # Clients that were refused together should not come back together.
            pause_s *= random.uniform(1, 2)
            timeout_s = deadline_s - time.monotonic() - pause_s
            if timeout_s <= 0:
                return reply
            yield Pause(pause_s)

    def _query(
        self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float
    ) -> Steps[wire.Message | NoReply]:
        """Send a query once; forgets the server if another one replied, or none."""
        reply: wire.Message | NoReply = yield Ask(key, payload, timeout_s)
        server = self.server
        if server is not None and (
            isinstance(reply, NoReply) or reply.get("instance") != server.instance
        ):
            self.server = None  # the clock and limits of a new one are not known yet
        return reply

    def _pack(self, body: wire.Message) -> bytes:
        payload = wire.pack(body)
        server = self.server
        if server is not None and len(payload) > server.message_bytes:
            raise LimitExceeded(
                f"a message of {len(payload):,} bytes exceeds the server's limit of "
                f"{server.message_bytes:,} bytes (--max-message-bytes)",
                field="message_bytes",
                limit=server.message_bytes,
                value=len(payload),
            )
        return payload
