"""A service on a Zenoh session: what a server and a replica have in common, and monitoring sees."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack

import zenoh

from zenoh_tf._zenoh.abandoned_keys import AbandonedKeys
from zenoh_tf._zenoh.link_sockets import LinkSockets
from zenoh_tf._zenoh.outbox_links import OutboxLinks
from zenoh_tf._zenoh.replies import Replies
from zenoh_tf.mirrors.free_memory import FreeMemory

from ..fair_share import FairShare
from ..requests.handler import Handler
from .clients import Clients
from .workers import Workers


class RunningServer:
    """Serves from the end of construction to `close`."""

    def __init__(
        self,
        session: zenoh.Session,
        service: Handler,
        clients: Clients,
        key: Callable[[str], str],
        workers: int,
        stack: ExitStack,
    ) -> None:
        """Prepare to serve, until `stack` is closed. `key`: of a request type. `workers`: threads
        for each of them."""
        self.session = session
        self.service = service
        self.key = key
        self.clients = clients
        sockets = LinkSockets(session)
        stack.callback(sockets.close)
        limits = service.limits
        unread = FairShare(limits, "all_unread_reply_bytes", "unread_reply_bytes")
        links = OutboxLinks(sockets, clients)
        replies = Replies(links, unread, 2 * limits.unread_reply_bytes, service.error)
        stack.callback(replies.close)
        clients.when_gone(replies.forget)
        clients.when_gone(service.client_gone)
        service.add_counters(replies.counters)
        self.workers = Workers(service, clients, replies, workers)
        self._stack = stack

    def serve(self, authorities: Callable[[], Iterable[str]] | None) -> None:
        """Answer queries. `authorities`: those that have published, if this server's router is to
        free their keys once they are gone."""
        stack, tree = self._stack, self.service.name
        memory = FreeMemory()
        stack.callback(memory.close)
        memory.start()
        if authorities is not None:
            abandoned = AbandonedKeys(self.session, tree, authorities)
            stack.callback(abandoned.close)
            self.clients.when_gone(abandoned.client_gone)
            abandoned.start()
        self.clients.start(self.session, tree)
        stack.callback(self.workers.close)
        self.workers.start(self.session, self.key)

    def close(self) -> None:
        """Serve no more."""
        self._stack.close()
