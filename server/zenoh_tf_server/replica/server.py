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

from ..process.upstream import Upstream
from ..security import access_rules
from ..settings import ServerSettings
from ..transport.running_server import RunningServer
from .copies import SharedCopies
from .service import ReplicaService
from .sessions import ReplicaSessions


class ReplicaServer(RunningServer):
    """A replica of the server of a tree."""

    def __init__(self, settings: ServerSettings, loop: asyncio.AbstractEventLoop) -> None:
        """Serve. Raises NetworkError or TransformException."""
        limits = settings.limits
        # Closed in reverse order: first the queries, then the copy, then the session.
        with ExitStack() as stack:
            security = settings.security
            sessions = ReplicaSessions(settings.listen, settings.replica_of, limits, security)
            stack.callback(sessions.close)
            primary = Upstream(sessions.primary, settings.tree, user=security.credentials.user)
            primary.wait(settings.replica_of, security.credentials)
            enforced = primary.access
            session = sessions.open_clients(settings.tree, enforced)
            own_id = secrets.token_hex(8)
            copies = SharedCopies(settings.sharing, settings.tree, own_id)
            service = ReplicaService(settings.tree, own_id, limits, loop, copies, primary)
            service.access = lambda: _access(enforced, primary.access, security.credentials.user)
            key = functools.partial(keys.replica_request, settings.tree, str(session.zid()))
            request_types = keys.REPLICA_REQUEST_TYPES
            super().__init__(session, service, key, settings.workers, stack, request_types)
            service.is_connected = self.clients.is_connected
            stack.callback(service.close)
            service.wait_for_copy()
            self.serve(service.authorities)
            self._stack = stack.pop_all()


def _access(
    enforced: Mapping[str, Any] | None, primary: Mapping[str, Any] | None, user: str | None
) -> dict[str, Any] | None:
    """What `hello` says that clients may do: what both the replica's rules, which are made when it
    starts, and those of the primary allow."""
    access = access_rules.common(enforced, primary)
    return None if access is None else {**access, "replica_user": user}
