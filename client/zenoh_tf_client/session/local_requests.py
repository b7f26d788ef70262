"""Sends short requests to a server on this host through a Unix socket, and all others over Zenoh.

That takes a quarter of the time. Each call has a connection for itself and waits in the system for
the reply, so there is no hand-over between threads. If the socket fails in the middle of a request,
the same bytes go over Zenoh: the server remembers the ids of writes, so it applies them once.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import threading
import time
from typing import TYPE_CHECKING, Final

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import handover, keys
from zenoh_tf._net.handover import CLIENT, MAX_REQUEST_BYTES, REPLY, REQUEST, REQUEST_TYPES
from zenoh_tf._net.queries import NoReply, Queries
from zenoh_tf.errors import TransformException
from zenoh_tf.shared_tree import RegionRefused

from .calls import is_forked

if TYPE_CHECKING:
    from .server_info import ServerInfo

#: As many calls of one client go through the socket at once.
_MAX_CONNECTIONS: Final = 16
_OPEN_S: Final = 0.5
#: After a failure, how long no other connection is tried.
_RETRY_S: Final = 5.0
_READ_BYTES: Final = 8192
#: A socket fails when its server ends. Zenoh removes its own connection to it at the same time,
#: and a query that is sent meanwhile may never end; so it is sent so much later.
_CLOSING_S: Final = 0.02

log = logging.getLogger("zenoh_tf.client")


class _LostError(Exception):
    """The connection failed. `sent`: the server may have got the request."""

    def __init__(self, sent: bool) -> None:
        super().__init__()
        self.sent = sent


class _Peer:
    """A connection to one server instance, for one request at a time."""

    __slots__ = ("_socket", "_timeout_s", "instance")

    def __init__(self, connection: socket.socket, instance: str) -> None:
        connection.settimeout(None)
        self._socket = connection
        self._timeout_s: float | None = None
        self.instance = instance

    def send_client(self, client_id: str) -> None:
        """Send the server the id of the client whose connection it is."""
        data = client_id.encode()
        self._socket.sendall(REQUEST.pack(len(data), CLIENT) + data)

    def ask(self, request: bytes, timeout_s: float) -> bytes:
        """Send a request and return the reply.

        Raises:
            TimeoutError: The reply did not come in time.
            _LostError: The connection failed.
        """
        peer = self._socket
        if timeout_s != self._timeout_s:  # it costs a system call
            self._set_timeout(timeout_s)
        try:
            sent = peer.send(request)
        except BlockingIOError as error:
            raise TimeoutError from error
        except OSError as error:  # it was closed before: the server gets nothing of this
            raise _LostError(sent=False) from error
        try:
            if sent < len(request):
                peer.sendall(request[sent:])
            data = peer.recv(_READ_BYTES)
            if len(data) >= REPLY.size:  # the common case
                length = REPLY.size + REPLY.unpack_from(data)[0]
                if len(data) == length:
                    return data[REPLY.size :]
            return self._rest(data, time.monotonic() + timeout_s)
        except BlockingIOError as error:
            raise TimeoutError from error
        except OSError as error:
            raise _LostError(sent=True) from error

    def shut(self) -> None:
        """End the connection, and a call that waits on it."""
        # Closing would not be enough: a forked child has the connection as well.
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self.shut()
        self._socket.close()

    def _set_timeout(self, timeout_s: float) -> None:
        """Let sends and reads end with BlockingIOError after a time.

        Python's own time-outs make two system calls of each.
        """
        seconds = int(timeout_s)
        value = struct.pack("ll", seconds, max(int((timeout_s - seconds) * 1e6), 1))
        for option in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
            self._socket.setsockopt(socket.SOL_SOCKET, option, value)
        self._timeout_s = timeout_s

    def _rest(self, data: bytes, deadline_s: float) -> bytes:
        parts = bytearray(data)
        while len(parts) < REPLY.size or len(parts) < REPLY.size + REPLY.unpack_from(parts)[0]:
            self._set_timeout(max(deadline_s - time.monotonic(), 0.001))
            more = self._socket.recv(1 << 20)
            if not more:
                raise ConnectionResetError("the server has closed the connection")
            parts += more
        return bytes(parts[REPLY.size :])


class LocalRequests:
    """The connections of one client to the server on its host; see the module."""

    def __init__(self, queries: Queries, tree: str, client_id: str, *, on: bool = True) -> None:
        """`on`: False if all requests go over Zenoh."""
        self._queries = queries
        self._tree = tree
        self._client_id = client_id
        #: The key of each type of request that may go through the socket, and what its header says.
        self._headers = {
            zenoh.KeyExpr(keys.request(tree, name)): header
            for header, name in REQUEST_TYPES.items()
            if on
        }
        #: Connections that no call uses. Borrowed and put back without a lock.
        self._idle: list[_Peer] = []
        self._lock = threading.Lock()
        # Guarded by the lock.
        self._peers: set[_Peer] = set()
        self._count = 0  # of connections, also while they are opened
        self._closed = False
        self._next_try_s = 0.0
        #: A server that is on another host.
        self._far: ServerInfo | None = None
        #: Replies that came through the socket. A lost count does no harm.
        self.replies = 0

    def ask(
        self, server: ServerInfo | None, key: zenoh.KeyExpr, payload: bytes, timeout_s: float
    ) -> bytes | NoReply:
        """As `Queries.ask`. `server`: the one that answered last; None if that is not known."""
        if (
            server is None
            or server is self._far
            or server.offer is None
            or not server.offer.requests
            or len(payload) > MAX_REQUEST_BYTES
            or is_forked()
        ):
            return self._queries.ask(key, payload, timeout_s)
        header = self._headers.get(key)
        peer = None if header is None else self._acquire(server, server.offer)
        if header is None or peer is None:
            return self._queries.ask(key, payload, timeout_s)
        deadline_s = time.monotonic() + timeout_s
        sent = True
        try:
            data = peer.ask(REQUEST.pack(len(payload), header) + payload, timeout_s)
        except TimeoutError:
            self._drop(peer)
            return self._queries.timed_out(timeout_s)
        except _LostError as lost:
            self._drop(peer)
            sent = lost.sent
            time.sleep(_CLOSING_S)
        except BaseException:  # a reply that nobody has read would be taken for the next one
            self._drop(peer)
            raise
        else:
            self._idle.append(peer)
            if self._closed:
                self._drop_idle()
            if data:
                self.replies += 1
                return data
        reply = self._queries.ask(key, payload, max(deadline_s - time.monotonic(), 0.001))
        if sent and type(reply) is bytes:
            message = wire.unpack(reply, wire.MAX_REPLY_BYTES)
            if message.get("instance") != server.instance:
                # Only the server that is gone knew what became of the request.
                return self._queries.went_away()
        return reply

    def close(self) -> None:
        """End all connections; calls that use one fail soon. May be called again."""
        if is_forked():  # they are the parent's as well
            return
        with self._lock:
            self._closed = True
            for peer in self._peers:
                peer.shut()
        self._drop_idle()

    def _acquire(self, server: ServerInfo, offer: handover.Offer) -> _Peer | None:
        """A connection that no other call uses. None: ask over Zenoh."""
        while True:
            try:
                peer = self._idle.pop()
            except IndexError:
                return self._open(server, offer)
            if peer.instance == server.instance:
                return peer
            self._drop(peer)

    def _open(self, server: ServerInfo, offer: handover.Offer) -> _Peer | None:
        with self._lock:
            if self._closed or self._count >= _MAX_CONNECTIONS:
                return None
            if time.monotonic() < self._next_try_s:
                return None
            self._count += 1
        peer = None
        try:
            if offer.host != handover.boot_id():
                self._far = server
                raise RegionRefused("the server is on another host")
            connection = handover.connect(offer, self._tree, server.instance, _OPEN_S)
            peer = _Peer(connection, server.instance)
            peer.send_client(self._client_id)
        except (OSError, RegionRefused, TransformException) as error:
            log.debug("requests go over Zenoh: %s (tree %r)", error, self._tree)
            self._drop(peer)
            self._next_try_s = time.monotonic() + _RETRY_S
            if isinstance(error, ConnectionError):
                time.sleep(_CLOSING_S)
            return None
        except BaseException:
            self._drop(peer)
            raise
        with self._lock:
            self._peers.add(peer)
            if not self._closed:
                return peer
        self._drop(peer)
        return None

    def _drop_idle(self) -> None:
        with contextlib.suppress(IndexError):
            while True:
                self._drop(self._idle.pop())

    def _drop(self, peer: _Peer | None) -> None:
        """Close a connection that was counted."""
        with self._lock:
            self._count -= 1
            if peer is not None:
                self._peers.discard(peer)
        if peer is not None:
            peer.close()
