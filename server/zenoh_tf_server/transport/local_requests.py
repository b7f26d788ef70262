"""Serves short requests of clients on this host, who send them through a Unix socket.

A client gets its connection from `sharing`. Each connection has a thread, which reads a request,
serves it, and sends the reply before it reads the next one. So a client that sends much, or reads
nothing, holds up nobody but itself, and what a connection costs is bounded. There are no hand-overs
between threads: those and Zenoh are four fifths of the time of a query that writes.

As many requests of a type may be served at once as by `workers`. Others wait in a lane, where
clients take turns, within the same bounds as queries. Long requests and replies, waiting lookups
and other types stay with Zenoh.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import threading
import time
from typing import Final

from zenoh_tf import threads
from zenoh_tf._net.handover import (
    CLIENT,
    MAX_REPLY_BYTES,
    MAX_REQUEST_BYTES,
    REPLY,
    REQUEST,
    REQUEST_TYPES,
)
from zenoh_tf.errors import TransformException
from zenoh_tf.text import quoted

from ..fair_share import FairShare
from ..rate_limited_log import RateLimitedLog
from ..requests.handler import UNKNOWN, Handler
from .clients import Clients
from .lanes import Admission, QueuedRequest, QueueShares

log = logging.getLogger("zenoh_tf.server")

#: Connections of one client. Its threads make calls side by side.
_MAX_OF_CLIENT: Final = 32
_MAX_ID_BYTES: Final = 64
#: A client that does not say who it is for this long loses the connection.
_ID_S: Final = 5.0
#: A client that reads nothing of a reply for this long loses the connection.
_CUT_OFF_S: Final = 10
_READ_BYTES: Final = 8192


class _Malformed(Exception):
    """A client has sent no valid request; the message is one line for the log."""


class _Reply:
    """The ReplyCallback of one request: keeps the reply for the thread of the connection."""

    __slots__ = ("client", "data")

    def __init__(self, client: str) -> None:
        self.client = client
        self.data = b""

    def __call__(self, reply: bytes, failed: bool) -> None:
        self.data = reply


class _Turns(Admission[threading.Condition]):
    """Admission for threads that wait until it is their request's turn."""

    def _queue(self, client: str, size: int) -> TransformException | None:
        turn = threading.Condition(self._lock)
        refusal = self.enqueue(QueuedRequest(turn, "", client, size))
        if refusal is None:
            turn.wait()  # without the lock
        return refusal

    def _resume(self, request: QueuedRequest[threading.Condition]) -> None:
        request.query.notify()


class _LocalConnection:
    """A connection and the client that it says it is of."""

    __slots__ = ("claimed", "socket", "thread")

    def __init__(self, peer: socket.socket) -> None:
        self.socket = peer
        self.claimed = UNKNOWN
        self.thread: threading.Thread | None = None

    def read_client(self) -> str:
        """The id that the client sends first; empty if it closes the connection instead."""
        begin = self.socket.recv(REQUEST.size)
        if not begin:
            return ""
        size, name = REQUEST.unpack(begin + self._exactly(REQUEST.size - len(begin)))
        if name != CLIENT or not 0 < size <= _MAX_ID_BYTES:
            raise _Malformed("it does not begin with a client's id")
        return self._exactly(size).decode("ascii", "replace")

    def read(self) -> tuple[str, bytes] | None:
        """The next request: its type and message. None: the client has closed the connection."""
        data = self.socket.recv(_READ_BYTES)
        if not data:
            return None
        if len(data) < REQUEST.size:
            data += self._exactly(REQUEST.size - len(data))
        size, name = REQUEST.unpack_from(data)
        request_type = REQUEST_TYPES.get(name)
        if request_type is None:
            raise _Malformed(f"it sends a request of type {quoted(name)}")
        if size > MAX_REQUEST_BYTES:
            raise _Malformed(f"it sends {size} bytes: the limit is {MAX_REQUEST_BYTES}")
        missing = REQUEST.size + size - len(data)
        if missing < 0:
            raise _Malformed("it sends a request before it has the reply to the last one")
        if missing:
            data += self._exactly(missing)
        return request_type, data[REQUEST.size :]

    def send(self, data: bytes) -> None:
        """Send a reply; raises OSError if the client does not read."""
        self.socket.sendall(REPLY.pack(len(data)) + data)

    def end(self) -> None:
        """Let the thread read no more; it sends the reply that it owes."""
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RD)

    def _exactly(self, count: int) -> bytes:
        data = self.socket.recv(count, socket.MSG_WAITALL)
        if len(data) < count:
            raise ConnectionResetError("the client has gone in the middle of a request")
        return data


class LocalRequests:
    """The connections of clients on this host; see the module."""

    def __init__(self, service: Handler, clients: Clients, shares: QueueShares, count: int) -> None:
        """`count`: how many requests of a type may be served at once."""
        self._service = service
        self._clients = clients
        self._turns = {name: _Turns(shares, count) for name in REQUEST_TYPES.values()}
        self._lines = RateLimitedLog(log)
        self._lock = threading.Lock()
        # Guarded by the lock.
        self._connections: set[_LocalConnection] = set()
        self._shares = FairShare(service.limits, "local_connections", _MAX_OF_CLIENT)
        self._closed = False
        clients.when_gone(self._client_gone)
        service.add_counters(lambda: {"local_connections": len(self._connections)})

    def take(self, peer: socket.socket) -> None:
        """Serve a client from now on; closes the connection if there are too many."""
        peer.settimeout(_ID_S)
        # Not a time-out of Python's, which would ask the system before each read, too.
        cut_off = struct.pack("ll", _CUT_OFF_S, 0)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, cut_off)
        connection = _LocalConnection(peer)
        with self._lock:
            most = self._service.limits.local_connections
            if self._closed or len(self._connections) >= most:
                peer.close()
                return
            self._connections.add(connection)
        try:
            connection.thread = threads.start("local", self._serve, connection)
        except RuntimeError:  # the system has no thread left; the client uses Zenoh instead
            self._forget(connection)
            peer.close()

    def close(self) -> None:
        """Read no more requests, and reply to those that were read."""
        with self._lock:
            self._closed = True
            connections = list(self._connections)
        for connection in connections:
            connection.end()
        deadline_s = time.monotonic() + threads.JOIN_TIMEOUT_S
        for connection in connections:
            if connection.thread is not None:
                connection.thread.join(max(0.0, deadline_s - time.monotonic()))

    def _client_gone(self, client: str) -> None:
        """Close the connections of a client. A forked child of its process may keep them open."""
        with self._lock:
            connections = [each for each in self._connections if each.claimed == client]
        for connection in connections:
            connection.end()

    def _serve(self, connection: _LocalConnection) -> None:
        try:
            if self._admit(connection, connection.read_client()):
                connection.socket.settimeout(None)
                while (request := connection.read()) is not None:
                    self._reply(connection, *request)
        except BlockingIOError:
            self._lines.warn(_name(connection), f"has read nothing for {_CUT_OFF_S} s: cut off")
        except OSError:
            pass  # the client has gone
        except _Malformed as reason:
            self._lines.warn(_name(connection), f"{reason}: closed the connection")
        except Exception:  # it must be forgotten
            log.exception("internal error while serving a client of this host")
        finally:
            self._forget(connection)
            connection.socket.close()

    def _admit(self, connection: _LocalConnection, claimed: str) -> bool:
        """Count a connection of the client that it claims to be of. False: it is one too many."""
        if not claimed:
            return False
        with self._lock:
            if not self._shares.try_take(claimed, 1):
                return False
            connection.claimed = claimed
            return True

    def _forget(self, connection: _LocalConnection) -> None:
        with self._lock:
            self._connections.discard(connection)
            if connection.claimed:
                self._shares.give_back(connection.claimed, 1)

    def _reply(self, connection: _LocalConnection, request_type: str, data: bytes) -> None:
        """Serve a request and reply."""
        client = self._clients.known(connection.claimed)
        turns = self._turns[request_type]
        refusal = turns.queue_if_busy(client, len(data))
        if refusal is None:
            reply = _Reply(client)
            try:
                self._service.handle(request_type, data, reply)
            finally:
                turns.end()
            # It may not be there yet: that of a waiting lookup, or to a write that runs already.
            answer = reply.data
        else:
            answer = self._service.error(refusal)
        connection.send(answer if len(answer) <= MAX_REPLY_BYTES else b"")


def _name(connection: _LocalConnection) -> str:
    return f"client {connection.claimed or '(unknown)'} on this host"
