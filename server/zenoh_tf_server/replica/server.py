"""A running replica: it listens for its clients, and is itself a client of its primary.

So it has two sessions that nothing joins: its keys are those of any server of the tree, and no
query reaches both (docs/explanation/decisions/0014-a-replica-is-a-read-only-server.md).
"""

from __future__ import annotations

import asyncio
import functools
from contextlib import ExitStack
from dataclasses import replace
from typing import Final

import zenoh

from zenoh_tf._net import keys, zenoh_config
from zenoh_tf._zenoh.link_sockets import LinkSockets
from zenoh_tf.threads import Periodic

from ..process import network
from ..process.upstream import Upstream
from ..requests.guard import RequestGuard
from ..security.settings import OPEN
from ..settings import ServerSettings
from ..transport.clients import Clients
from ..transport.running_server import RunningServer
from .copies import SharedCopies
from .service import ReplicaService

#: As old is what a replica serves that follows another one whose primary is gone, and as long it
#: stays there before it tries all endpoints again.
_STALE_S: Final = 10.0


class ReplicaServer(RunningServer):
    """A replica of the server of a tree."""

    def __init__(self, settings: ServerSettings, loop: asyncio.AbstractEventLoop) -> None:
        """Serve. Raises NetworkError or TransformException."""
        limits, security, tree = settings.limits, settings.security, settings.tree
        # Closed in reverse order: first the queries, then the copy, then the sessions.
        with ExitStack() as stack:
            own = replace(OPEN, credentials=security.credentials)
            upstream = network.open_session([], settings.replica_of, limits, own, tree)
            stack.callback(upstream.close)
            primary = Upstream(upstream, tree, user=security.credentials.user)
            primary.wait(settings.replica_of, security.credentials)
            session = network.open_session(settings.listen, [], limits, security, tree)
            stack.callback(session.close)
            token = _ServerToken(session, tree)
            copies = SharedCopies(settings.sharing, tree)
            guard = RequestGuard(
                security.rules, certificate_of=functools.partial(network.certificate_of, session)
            )
            where = ", ".join(map(zenoh_config.address, settings.replica_of))
            clients = Clients(limits.connections)
            stack.callback(clients.close)
            service = ReplicaService(
                *(tree, where, limits, loop, copies, primary, session, guard, token.declare),
                clients.is_connected,
            )
            stack.callback(service.close)
            service.wait_for_copy()
            if len(settings.replica_of) > 1:
                _follow_the_primary(service, upstream, stack)
            key = functools.partial(keys.request, tree)
            super().__init__(session, service, clients, key, settings.workers, stack)
            self.serve(service.authorities)
            # Withdrawn first when it closes, so that clients learn of it.
            stack.callback(token.close)
            token.serve()
            self._stack = stack.pop_all()


def _follow_the_primary(service: ReplicaService, upstream: zenoh.Session, stack: ExitStack) -> None:
    """End links on which nothing new comes, until `stack` closes: Zenoh then connects to the first
    endpoint that opens. Else replicas that name each other would follow one another for good."""
    sockets = LinkSockets(upstream)
    stack.callback(sockets.close)

    def check() -> None:
        if service.age_s > _STALE_S:
            for peer in sockets.peers():
                sockets.cut(peer)

    checks = Periodic("stale upstream", check, _STALE_S)
    stack.callback(checks.close)
    checks.start()


class _ServerToken:
    """The liveliness token of a server, as of the primary's instance that is served.

    Thread safety: `declare` by the thread of the feed; `serve` and `close` by one other.
    """

    def __init__(self, session: zenoh.Session, tree: str) -> None:
        self._session = session
        self._tree = tree
        self._instance = ""
        self._token: zenoh.LivelinessToken | None = None
        self._is_serving = False

    def declare(self, instance: str) -> None:
        """From now on, this instance's tree is served."""
        if instance == self._instance:
            return
        self._instance = instance
        if self._is_serving:
            before, self._token = self._token, self._make()  # there is always one
            if before is not None:
                before.undeclare()

    def serve(self) -> None:
        """Let clients see it from now on: requests are answered."""
        self._is_serving = True
        self._token = self._make()

    def close(self) -> None:
        self._is_serving = False
        if self._token is not None:
            self._token.undeclare()

    def _make(self) -> zenoh.LivelinessToken:
        key = keys.server(self._tree, self._instance)
        return self._session.liveliness().declare_token(key)
