"""A running replica: a router of the primary's network that answers reads from a copy of the tree.

It declares no key of the primary. Its own keys name its router, so a query of another router's
client never gets here, and exactly one server executes each read
(docs/explanation/decisions/0014-replicas-have-keys-of-their-own.md). Writes and puts of its clients
pass through its router to the primary.
"""

from __future__ import annotations

import asyncio
import functools
import secrets
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

from zenoh_tf._net import keys
from zenoh_tf.mirrors.free_memory import FreeMemory

from ..process.abandoned_keys import AbandonedKeys
from ..process.upstream import Upstream
from ..security import access_rules
from ..settings import ServerSettings
from ..transport.workers import Workers, open_replies
from .copies import SharedCopies
from .service import ReplicaService
from .sessions import ReplicaSessions


class ReplicaServer:
    """Serves from construction to `close`. Raises NetworkError or TransformException."""

    def __init__(self, settings: ServerSettings, loop: asyncio.AbstractEventLoop) -> None:
        limits = settings.limits
        # Closed in reverse order: first the queries, then the copy, then the session.
        with ExitStack() as stack:
            security = settings.security
            sessions = ReplicaSessions(settings.listen, settings.replica_of, limits, security)
            stack.callback(sessions.close)
            primary = Upstream(sessions.primary, settings.tree, user=security.credentials.user)
            primary.wait(settings.replica_of, security.credentials)
            enforced = primary.access
            self.session = session = sessions.open_clients(settings.tree, enforced)
            own_id = secrets.token_hex(8)
            copies = SharedCopies(settings.sharing, settings.tree, own_id)
            self.service = service = ReplicaService(settings.tree, own_id, limits, loop, copies)
            service.access = lambda: _access(enforced, primary.access, security.credentials.user)
            clients, replies = open_replies(session, service, stack)
            self.clients = clients
            service.is_connected = clients.is_connected
            stack.callback(service.close)
            service.start(primary)
            workers = Workers(
                service, clients, replies, settings.workers, keys.REPLICA_REQUEST_TYPES
            )
            memory = FreeMemory()
            stack.callback(memory.close)
            memory.start()
            abandoned = AbandonedKeys(session, settings.tree, service.authorities)
            stack.callback(abandoned.close)
            clients.when_gone(abandoned.client_gone)
            abandoned.start()
            clients.start(session, settings.tree)
            stack.callback(workers.close)
            #: The key of a request type.
            self.key = functools.partial(keys.replica_request, settings.tree, str(session.zid()))
            workers.start(session, self.key)
            self._stack = stack.pop_all()

    @property
    def instance(self) -> str:
        """The instance id in replies: that of the primary whose state is served."""
        return self.service.instance

    @property
    def age_s(self) -> float | None:
        """How old what is served may be, in seconds."""
        return self.service.age_s

    def close(self) -> None:
        """Serve no more."""
        self._stack.close()


def _access(
    enforced: Mapping[str, Any] | None, primary: Mapping[str, Any] | None, user: str | None
) -> dict[str, Any] | None:
    """What `hello` says that clients may do: what both the replica's rules, which are made when it
    starts, and those of the primary allow."""
    access = access_rules.common(enforced, primary)
    return None if access is None else {**access, "replica_user": user}
