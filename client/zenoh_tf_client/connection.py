"""One Zenoh session with the server of one tree: sends requests, and reports missing replies.

Thread safety: all methods; calls of different threads run side by side.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import threading
import time
from dataclasses import dataclass
from typing import Final, TypeVar

import zenoh

from zenoh_tf import handover, keys, wire, zenoh_config
from zenoh_tf.credentials import NO_CREDENTIALS, Credentials
from zenoh_tf.errors import (
    InvalidArgumentException,
    LimitExceeded,
    OutcomeUnknown,
    ServerBusy,
    ServerRestarted,
    ServerUnavailable,
    TransformException,
)

from . import info_requests
from .access import Access
from .local_requests import LocalRequests
from .opening import open_session
from .queries import NoReply, Queries
from .receipt import Receipt, later
from .request import Request
from .served_trees import no_server_message, served_trees
from .session_calls import SessionCalls

T = TypeVar("T")

_HELLO_PERIOD_S: Final = 0.05
#: A client that makes calls says hello again this often: clocks drift apart, and the server
#: measures them.
_CLOCK_PERIOD_S: Final = 10.0
#: The second time comes sooner, as it is the first that can tell a round trip.
_FIRST_CLOCK_PERIOD_S: Final = 1.0
#: How much longer a read may take for it.
_CLOCK_TIMEOUT_S: Final = 0.5
#: If other trees are served, the wait for one that is not ends after this time.
_OTHER_TREES_GRACE_S: Final = 1.0
_OTHER_TREES_PERIOD_S: Final = 0.25
_OTHER_TREES_TIMEOUT_S: Final = 0.4
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


class Connection:
    """A session with one server; see the module. Close it with `close`."""

    def __init__(
        self,
        endpoint: str,
        tree: str,
        timeout_s: float,
        credentials: Credentials = NO_CREDENTIALS,
        *,
        local: bool = True,
    ) -> None:
        """Connect to the server of `tree` at `endpoint`.

        `local`: send requests through the server's socket as well, if it is on this host.

        Raises:
            ServerUnavailable: No server answered within `timeout_s`.
            AccessDenied: The server does not let this client in, or cannot be trusted.
            InvalidArgumentException: `endpoint` or `timeout_s` makes no sense.
        """
        if not 0 < timeout_s < 1e6:
            raise InvalidArgumentException(
                f"timeout_s must be positive, not {timeout_s!r}", field="timeout_s"
            )
        zenoh_config.check_endpoint(endpoint)
        zenoh_config.check_encrypted(endpoint, credentials)
        self.endpoint = endpoint
        self._credentials = credentials
        self._address = zenoh_config.address(endpoint)  # for messages: without secrets
        self.tree = tree
        self.timeout_s = timeout_s
        self._keys = {name: zenoh.KeyExpr(keys.operation(tree, name)) for name in keys.OPERATIONS}
        self._server: ServerInfo | None = None
        self._round_trip_ns: int | None = None  # of the last hello
        self._next_hello_s = 0.0
        #: Of the latest write that the server has replied to.
        self.last_receipt: Receipt | None = None
        self._receipt_lock = threading.Lock()
        #: What this client may do; None if the server has no access rules.
        self._access: Access | None = None
        # A request id: random per connection, then counted.
        self._id_prefix = os.urandom(8)
        self._id_count = itertools.count()
        deadline_s = time.monotonic() + timeout_s
        self.session = open_session(endpoint, tree, timeout_s, credentials)
        self.calls = SessionCalls(self.session.close)
        self.calls.add_owner(self)
        # Each query carries the client's id, so that the server can hold clients apart. The token
        # under the same id tells the server when the client is gone.
        self._client_id = client_id = str(self.session.zid())
        self._queries = Queries(
            self.session, self.calls, client_id, f"the server of tree {tree!r} at {self._address}"
        )
        self.local = LocalRequests(self._queries, tree, client_id, on=local)
        try:
            self._token = self.session.liveliness().declare_token(keys.client(tree, client_id))
            self._wait_for_server(deadline_s)
            if self._access is not None:
                self._access.check_any()
        except BaseException:
            self.close()
            raise

    def __del__(self) -> None:
        # Zenoh would close the session when it is freed, outside of `calls`.
        if hasattr(self, "local"):
            self.close()

    @property
    def instance(self) -> str:
        """Instance id of the server that answered last; asks for it if none is known."""
        return self._known_server().instance

    @property
    def known_instance(self) -> str | None:
        """The same without asking: None if no server is known."""
        server = self._server
        return None if server is None else server.instance

    @property
    def known_server(self) -> ServerInfo | None:
        """The server that answered last, without asking: None if none is known."""
        return self._server

    @property
    def closed(self) -> bool:
        """True once `close` was called."""
        return self.calls.closed

    def close(self) -> None:
        """Close the session; calls of other threads fail soon. May be called again."""
        self.calls.close()
        self.local.close()

    def check_publish(self, authority: str) -> None:
        """Raise AccessDenied if this client may not publish as `authority`."""
        if self._access is not None:
            self._access.check_publish(authority)

    def hello(self, timeout_s: float | None = None) -> ServerInfo:
        """Ask the server who it is, for its limits, and for what this client may do.

        Raises ServerUnavailable if it does not answer within `timeout_s`, or the usual time-out.
        """
        period_s = _FIRST_CLOCK_PERIOD_S if self._round_trip_ns is None else _CLOCK_PERIOD_S
        self._next_hello_s = time.monotonic() + period_s
        request = info_requests.hello(
            self._credentials.user, self._client_id, time.time_ns(), self._round_trip_ns
        )
        begin_ns = time.monotonic_ns()
        payload = wire.pack(request.body())
        if timeout_s is None:
            timeout_s = self.timeout_s
        reply = self._query(self._keys["hello"], payload, timeout_s)
        if isinstance(reply, NoReply) and reply.at_once:
            # Servers before access rules answer `hello` among the infos only.
            reply = self._query(self._keys["info"], payload, timeout_s)
        now_ns = time.monotonic_ns()
        if isinstance(reply, NoReply):
            raise ServerUnavailable(reply.reason)
        self._round_trip_ns = now_ns - begin_ns
        value = request.parse(reply)
        access = value.get("access")
        user = self._credentials.user
        self._access = None if access is None else Access(self.tree, self._address, user, access)
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
        self._server = server
        return server

    def call(self, request: Request[T]) -> T:
        """Send a request; return its result, or raise its error or those of `read` and `write`."""
        if request.writes:
            return request.parse(self.write(request.kind, request.body()))
        return request.parse(self.read(request.kind, request.body(), request.wait_s))

    def read(self, operation: str, body: wire.Message, wait_s: float = 0.0) -> wire.Message:
        """Return the reply to a request that changes nothing.

        `wait_s` is how long the server itself may wait before it replies. Raises the error in
        the reply, or ServerUnavailable if none comes.
        """
        key = self._key(operation, body)
        payload = self._pack(body)
        timeout_s = self.timeout_s + wait_s
        reply = self._query_until_served(key, payload, timeout_s)
        if isinstance(reply, NoReply):
            if reply.at_once:
                self._check_new_rules(operation, body)
            raise ServerUnavailable(reply.reason)
        if time.monotonic() >= self._next_hello_s:
            with contextlib.suppress(TransformException):  # the read itself was answered
                self.hello(_CLOCK_TIMEOUT_S)
        wire.raise_error(reply)
        return reply

    def write(
        self, operation: str, body: wire.Message, instance: str | None = None
    ) -> wire.Message:
        """Send a write, which the server applies at most once, and return the reply.

        With an `instance`, only that server instance may apply it; another one answers
        ServerRestarted. Raises the error in the reply, ServerUnavailable if nothing was sent,
        or OutcomeUnknown if no reply came: the write may or may not have been applied.
        """
        try:
            return self._write_once(operation, body, instance or self.instance)
        except ServerRestarted:
            # The new server rejected it, so it was not applied and may be sent again.
            self._server = None
            if instance is not None:
                raise
        return self._write_once(operation, body, self.instance)

    def _write_once(self, operation: str, body: wire.Message, instance: str) -> wire.Message:
        server = self._known_server()
        if time.monotonic() >= self._next_hello_s:
            server = self.hello()  # for an expiry by the clocks as they are now
        key = self._key(operation, body)
        timeout_ns = int(self.timeout_s * 1e9)
        write = wire.Write(
            self._id_prefix + next(self._id_count).to_bytes(8, "big"),
            time.monotonic_ns() + server.clock_offset_ns + timeout_ns,
            instance,
        )
        payload = self._pack(body | write.fields())
        # A refused write did not run, so it may be sent again; its expiry stays the same.
        reply = self._query_until_served(key, payload, self.timeout_s)
        if isinstance(reply, NoReply):
            raise OutcomeUnknown(f"{reply.reason}: the write may or may not have been applied")
        with self._receipt_lock:
            self.last_receipt = later(self.last_receipt, reply)
        wire.raise_error(reply)
        return reply

    def _key(self, operation: str, body: wire.Message) -> zenoh.KeyExpr:
        """The key of a request. Raises AccessDenied if the server's rules do not allow it."""
        access = self._access
        if access is None:
            return self._keys[operation]
        return zenoh.KeyExpr(access.key(operation, body))

    def _check_new_rules(self, operation: str, body: wire.Message) -> None:
        """Raise AccessDenied if the server was restarted with rules that do not allow a request.

        Zenoh gives no reply to a request that is denied, as if no server were there.
        """
        if self._server is None:
            with contextlib.suppress(ServerUnavailable):
                self.hello()
                self._key(operation, body)

    def _query_until_served(
        self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float
    ) -> wire.Message | NoReply:
        """As `_query`, and again as long as the server is busy and the time is not over."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            reply = self._query(key, payload, timeout_s)
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
            time.sleep(pause_s)

    def _query(
        self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float
    ) -> wire.Message | NoReply:
        """Send a request once; forgets the server if another one replied, or none."""
        if timeout_s > self.timeout_s:  # the server may wait before it replies
            reply = self._queries.ask(key, payload, timeout_s)
        else:
            reply = self.local.ask(self._server, key, payload, timeout_s)
        server = self._server
        if server is not None and (
            isinstance(reply, NoReply) or reply.get("instance") != server.instance
        ):
            self._server = None  # the clock and limits of a new one are not known yet
        return reply

    def _pack(self, body: wire.Message) -> bytes:
        payload = wire.pack(body)
        server = self._server
        if server is not None and len(payload) > server.message_bytes:
            raise LimitExceeded(
                f"a message of {len(payload):,} bytes exceeds the server's limit of "
                f"{server.message_bytes:,} bytes (--max-message-bytes)",
                field="message_bytes",
                limit=server.message_bytes,
                value=len(payload),
            )
        return payload

    def _known_server(self) -> ServerInfo:
        return self._server or self.hello()

    def _wait_for_server(self, deadline_s: float) -> None:
        """Ask until a server answers, because it may still be starting. Give up early if the
        network serves other trees only, because the name is then probably wrong."""
        next_check_s = time.monotonic() + _OTHER_TREES_GRACE_S
        while True:
            left_s = deadline_s - time.monotonic()
            try:
                self.hello(max(left_s, 0.1))
                return
            except ServerUnavailable:
                is_last = left_s <= _HELLO_PERIOD_S
                if is_last or time.monotonic() >= next_check_s:
                    trees = served_trees(self.session, _OTHER_TREES_TIMEOUT_S)
                    if is_last or (trees and self.tree not in trees):
                        raise ServerUnavailable(
                            no_server_message(self.tree, self._address, trees, self.timeout_s)
                        ) from None
                    next_check_s = time.monotonic() + _OTHER_TREES_PERIOD_S
            time.sleep(_HELLO_PERIOD_S)
