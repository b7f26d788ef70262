"""A running replica: a router of the primary's network that answers reads from a copy of the tree.

It declares no key of the primary. Its own keys name its router, so a query of another router's
client never gets here, and exactly one server executes each read
(docs/decisions/0014-replicas-have-keys-of-their-own.md). Writes and puts of its clients pass
through its router to the primary.
"""

from __future__ import annotations

import asyncio
import functools
import secrets
from contextlib import ExitStack

from zenoh_tf import keys

from . import network
from .abandoned_keys import AbandonedKeys
from .clients import Clients
from .free_memory import FreeMemory
from .link_sockets import LinkSockets
from .outbox_links import OutboxLinks
from .primary import Primary
from .replica_service import ReplicaService
from .replies import Replies
from .server import Settings
from .shared_copies import SharedCopies
from .workers import Workers


class ReplicaServer:
    """Serves from construction to `close`. Raises NetworkError or TransformException."""

    def __init__(self, settings: Settings, loop: asyncio.AbstractEventLoop) -> None:
        limits = settings.limits
        # Closed in reverse order: first the queries, then the copy, then the session.
        with ExitStack() as stack:
            self.session = session = network.open_replica_session(
                settings.listen, settings.replica_of, limits, settings.security
            )
            stack.callback(session.close)
            self.clients = clients = Clients(limits.connections)
            stack.callback(clients.close)
            sockets = LinkSockets()
            stack.callback(sockets.close)
            sockets.start(session)
            primary = Primary(session, settings.tree)
            primary.wait(settings.replica_of, settings.security.credentials)
            own_id = secrets.token_hex(8)
            copies = SharedCopies(settings.sharing, settings.tree, own_id)
            self.service = service = ReplicaService(settings.tree, own_id, limits, loop, copies)
            stack.callback(service.close)
            service.start(primary)
            replies = Replies(OutboxLinks(sockets, clients), limits, service.error)
            stack.callback(replies.close)
            clients.when_gone(replies.forget)
            clients.when_gone(service.client_gone)
            service.add_counters(replies.counters)
            workers = Workers(service, clients, replies, settings.workers, keys.NEAR_OPERATIONS)
            memory = FreeMemory()
            stack.callback(memory.close)
            memory.start()
            abandoned = AbandonedKeys(settings.tree, service.authorities)
            stack.callback(abandoned.close)
            clients.when_gone(abandoned.client_gone)
            abandoned.start(session)
            clients.start(session, settings.tree)
            stack.callback(workers.close)
            #: The key of a query family.
            self.key = functools.partial(keys.near_operation, settings.tree, str(session.zid()))
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
