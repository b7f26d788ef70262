"""What a replica asks its primary, and a site's server its robots, over a Zenoh session.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any, Final

import zenoh
from zenoh.handlers import RingChannel

from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._net.queries import NoReply, Queries
from zenoh_tf._zenoh import connect_failure
from zenoh_tf.errors import AccessDenied, ServerUnavailable
from zenoh_tf.mirrors.source import ServerStatus
from zenoh_tf.steps import Ask, Pause, Steps, decode, run

from .network import CONNECT_TIMEOUT_S, NetworkError

#: How long the primary may take for one reply.
_REPLY_TIMEOUT_S: Final = 5.0
_PERIOD_S: Final = 0.1
_EXPLAIN_TIMEOUT_S: Final = 1.0


class Upstream:
    """The `zenoh_tf.mirrors.feed.Source` of a server."""

    def __init__(
        self,
        session: zenoh.Session,
        tree: str,
        name: str | None = None,
        user: str | None = None,
        interest: wire.Interest | None = None,
        listen: Callable[[], Any] | None = None,
        is_there: Callable[[], bool] = lambda: True,
    ) -> None:
        """Say to the primary that its client is there. `name`: what messages call it. `user`: as
        whom the session connects. `interest`: whose stream is followed; None: everything.
        `listen` makes what its messages come from; None: each time a subscriber. Requests fail at
        once unless `is_there()`."""
        self._is_there = is_there
        self._session = session
        self._listen = listen
        self.tree = tree
        self._stream = keys.streams(tree, interest.id if interest else "")
        own_id = str(session.zid())
        #: Nothing needs to be entered: a server ends without the interpreter's finalization.
        self.calls: AbstractContextManager[None] = contextlib.nullcontext()
        self._queries = Queries(
            session, self.calls, own_id, name or f"the primary of tree {tree!r}"
        )
        #: What its rules allow this server, as it said last; None if it has no rules.
        self.access: dict[str, Any] | None = None
        self._user = user
        self._own_id = own_id
        self._token = session.liveliness().declare_token(keys.client(tree, own_id))

    def wait(self, endpoints: Sequence[str], credentials: Credentials) -> None:
        """Wait until the primary answers; it may be starting, too.

        Raises:
            NetworkError: It did not answer within CONNECT_TIMEOUT_S; the message says why.
        """
        deadline_s = time.monotonic() + CONNECT_TIMEOUT_S
        while True:
            try:
                run(self._status(1.0), self.take)
                return
            except ServerUnavailable as error:
                if time.monotonic() < deadline_s:
                    time.sleep(_PERIOD_S)
                    continue
                reason: Exception = error
                failure = connect_failure.explain_all(
                    endpoints, self.tree, _EXPLAIN_TIMEOUT_S, credentials
                )
                if isinstance(failure, AccessDenied):
                    reason = failure
                where = ", ".join(map(zenoh_config.address, endpoints))
                raise NetworkError(
                    f"the primary of tree {self.tree!r} does not answer through {where} within "
                    f"{CONNECT_TIMEOUT_S:g} s (--replica-of): {reason}"
                ) from error

    def subscribe(self, channel: RingChannel[zenoh.Sample]) -> Any:
        """Listen to the stream; see `Source`."""
        if self._listen is not None:
            return self._listen()
        return self._session.declare_subscriber(self._stream, channel)

    def unsubscribe(self, subscriber: zenoh.Subscriber[Any]) -> bool:
        """Undeclare a subscriber; see `Source`."""
        with contextlib.suppress(zenoh.ZError):
            subscriber.undeclare()
        return True

    def ask(self, request_type: str, body: wire.Message, wait_s: float) -> Steps[wire.Message]:
        """Send a request; see `Source`."""
        return self._ask(request_type, body, _REPLY_TIMEOUT_S + wait_s)

    def status(self) -> Steps[ServerStatus]:
        """Ask the primary for its instance id, its clock and its last commit; keeps what its rules
        allow."""
        return self._status(_REPLY_TIMEOUT_S)

    def take(self, step: Ask | Pause) -> bytes | NoReply:
        """Send a query, and wait for its outcome; see `Source`."""
        assert isinstance(step, Ask)
        return self._queries.ask(step.key, step.payload, step.timeout_s)

    def send(
        self, step: Ask, replied: Callable[[zenoh.Reply], None], ended: Callable[[], None]
    ) -> None:
        """Send a query, and return without its reply; see `Queries.send`."""
        if not self._is_there():
            raise ServerUnavailable("it has no server on this network")
        token = zenoh.CancellationToken()
        self._queries.send(step.key, step.payload, step.timeout_s, replied, ended, token)

    def outcome(self, step: Ask, data: bytes | None) -> bytes | NoReply:
        """The outcome of a query that was sent: the reply's bytes, or why there is none."""
        return self._queries.outcome(data, step.timeout_s)

    def _status(self, timeout_s: float) -> Steps[ServerStatus]:
        hello = wire.call_body("hello", user=self._user, client=self._own_id)
        reply = yield from self._ask("hello", hello, timeout_s)
        value = wire.mapping(reply, "value")
        access = value.get("access")
        if access is not None:
            access = {field: list(wire.texts(access, field)) for field in ("may", "publish")}
        self.access = access
        return ServerStatus(
            wire.text(reply, "instance"),
            wire.integer(value, "clock_ns"),
            wire.integer(value, "seq") if "seq" in value else None,
            wire.integer(value, "real_ns") if "real_ns" in value else None,
        )

    def _ask(self, request_type: str, body: wire.Message, timeout_s: float) -> Steps[wire.Message]:
        key = zenoh.KeyExpr(keys.request(self.tree, request_type))
        reply = decode((yield Ask(key, wire.pack(body), timeout_s)))
        if isinstance(reply, NoReply):
            raise ServerUnavailable(reply.reason)
        wire.raise_error(reply)
        return reply
