"""How much a client's link accepts without blocking, and which links a reply may go to.

A client that has said who it is, and is connected, has links of its own. The reply to any other
query may go to each link that never was a known client's, for example to a router with clients
behind it: it is sent when all of those have room. The server's queries to itself have no link.

For eclipse-zenoh/zenoh#1876, as `link_sockets`.

Thread safety: all methods.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from .link_sockets import LinkSocket, LinkSockets
from .server_parts import ConnectedClients

#: A link that is writable accepts this much, whatever the kernel has free: Zenoh's own queue has
#: room for two batches of 64 KiB.
UNCHECKED_ROOM: Final = 60_000
#: No more is sent at once, so that clients take turns.
_MAX_ROOM: Final = 1 << 20
#: The longest reply to a client that accepts no parts. It is sent when nothing is before it, and
#: then fits into the kernel's buffer of a usual system.
WHOLE_ROOM: Final = 2 << 20
#: In place of a file descriptor: the link is broken, but Zenoh has not closed it yet.
BROKEN: Final = -1


class OutboxLinks:
    """The links of clients, and whether they have room."""

    def __init__(self, sockets: LinkSockets, clients: ConnectedClients) -> None:
        self._sockets = sockets
        self._clients = clients

    def room(self, client: str) -> int | None:
        """How many bytes can be sent to the client without blocking; None if that of one
        of its links is not known."""
        room = _MAX_ROOM
        for link in self._links(client):
            if link is None:
                return None
            if not link.is_writable():
                return 0
            room = min(room, UNCHECKED_ROOM + link.free_bytes())
        return room

    def is_gone(self, client: str) -> bool:
        """True if this is the id of a client that is connected no more."""
        return bool(client) and not self._clients.known(client)

    def is_empty(self, client: str) -> bool:
        """True if all that was sent has arrived at the client's machine."""
        return all(link is not None and link.unsent_bytes() == 0 for link in self._links(client))

    def is_blind(self, client: str) -> bool:
        """True if the room of one of the client's links is not known."""
        return any(link is None for link in self._links(client))

    def full_link(self, client: str) -> int | None:
        """The file descriptor of a link without room, to poll; BROKEN if a poll cannot
        wait for it. None: all have room."""
        for link in self._links(client):
            if link is not None and not link.is_writable():
                return BROKEN if link.is_broken() else link.fd
        return None

    def cut_full(self, client: str) -> bool:
        """Cut the links that a reply to the client may go to and that have no room."""
        cut = False
        for peer in self._peers(client):
            links = self._sockets.of_peer(peer)
            if any(link is not None and not link.is_writable() for link in links):
                cut = self._sockets.cut(peer) or cut
        return cut

    def _links(self, client: str) -> Iterator[LinkSocket | None]:
        for peer in self._peers(client):
            yield from self._sockets.of_peer(peer)

    def _peers(self, client: str) -> list[str]:
        if client == self._clients.own:
            return []
        if client and self._sockets.of_peer(client):
            return [client]
        # The link of a client that is gone may stay for seconds, and be full: a new client,
        # whose token has not arrived yet, must not wait for it.
        peers = self._sockets.peers()
        return [peer for peer in peers if not self._clients.has_been_known(peer)]
