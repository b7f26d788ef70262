"""The sockets of the Zenoh links, to ask whether a send would block.

Zenoh has no call that sends without blocking (eclipse-zenoh/zenoh#1876 "Blocking push can block the
router indefinitely"; #2587 proposes a `try_put`). A reply to a client that does not read blocks the
sending thread, and Zenoh's routing tables with it: the next client that comes or goes then stops
everyone (docs/explanation/decisions/0008-replies-never-block.md). So the server asks the kernel
about the link's socket before it hands a reply to Zenoh. A client ends a link on which nothing
answers by its socket.

Only links over TCP (tcp, tls, ws) have such a socket, where the system lists a process's open
files. All others are unknown to this module.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import ctypes
import ipaddress
import logging
import os
import select
import socket
import stat
import struct
import sys
import threading
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Final

import zenoh

from zenoh_tf import unix

log = logging.getLogger("zenoh_tf")

_OPEN_FILES: Final = "/proc/self/fd"
#: Off: closing a socket returns at once, and the kernel sends what is left. Zenoh's default waits
#: up to 10 s, on a thread that receives messages.
_NO_LINGER: Final = struct.pack("ii", 0, 0)

#: A socket object would not do: Python gives one on a descriptor of another owner its default
#: timeout (`socket.setdefaulttimeout`), which makes that owner's socket non-blocking.
_LIBC: Final = unix.LIBC

_Address = tuple[str, int]


@dataclass(frozen=True, slots=True)
class LinkSocket:
    """A socket of Zenoh's: only asked, set up and shut down here, never read, written or closed."""

    fd: int
    inode: int  # differs from that of a later socket with the same number

    def do_not_linger(self) -> None:
        """Let a close of the socket return at once."""
        _LIBC.setsockopt(self.fd, socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER, len(_NO_LINGER))

    def shut(self) -> bool:
        """End the connection: Zenoh finds it broken. False: it was closed before."""
        return self.is_open() and _LIBC.shutdown(self.fd, socket.SHUT_RDWR) == 0

    def is_open(self) -> bool:
        """True if the link still has its socket."""
        try:
            return os.fstat(self.fd).st_ino == self.inode
        except OSError:
            return False

    def is_writable(self) -> bool:
        """True if the kernel accepts more, so that Zenoh's sending task makes progress, or if the
        socket is closed, so that Zenoh drops what is sent. While a broken link is still open,
        Zenoh blocks whoever sends."""
        events = self._events()
        return events == select.POLLOUT or (events != 0 and not self.is_open())

    def is_broken(self) -> bool:
        """True if nothing can be sent any more: a poll for room would return at once."""
        return self._events() & ~select.POLLOUT != 0

    def _events(self) -> int:
        poll = select.poll()
        poll.register(self.fd, select.POLLOUT)
        return next((events for _, events in poll.poll(0)), 0)

    def unsent_bytes(self) -> int:
        """The bytes that were written, and that the other end has not acknowledged."""
        return unix.unsent_bytes(self.fd)

    def free_bytes(self) -> int:
        """How many bytes the kernel accepts at least. It counts what it spends beside the bytes,
        too, hence only a quarter of the buffer."""
        buffer = ctypes.c_int()  # stays 0 if the socket is closed
        size = ctypes.c_uint32(ctypes.sizeof(buffer))
        _LIBC.getsockopt(
            self.fd, socket.SOL_SOCKET, socket.SO_SNDBUF, ctypes.byref(buffer), ctypes.byref(size)
        )
        return max(0, buffer.value // 4 - self.unsent_bytes())


class LinkSockets:
    """The sockets of a session's links, by the Zenoh id at the other end."""

    def __init__(self, session: zenoh.Session) -> None:
        """Follow the session's links."""
        self._lock = threading.Lock()
        self._by_peer: dict[str, dict[str, LinkSocket | None]] = {}  # peer: link: socket
        self._leaving: list[tuple[str, str, LinkSocket]] = []  # also in `_by_peer`
        self._listener = session.info.declare_link_events_listener(self._changed, history=True)

    def close(self) -> None:
        """Follow no more links."""
        self._listener.undeclare()

    def of_peer(self, peer: str) -> list[LinkSocket | None]:
        """The sockets of the links to a peer; None for a link whose socket is not known."""
        with self._lock:
            self._forget_left()
            return list(self._by_peer.get(peer, {}).values())

    def peers(self) -> list[str]:
        """The Zenoh ids at the other ends of all links."""
        with self._lock:
            self._forget_left()
            return list(self._by_peer)

    def cut(self, peer: str) -> bool:
        """End the links to a peer: Zenoh finds them broken. False: no socket of it is known."""
        found = [link is not None and link.shut() for link in self.of_peer(peer)]
        return any(found)

    def _changed(self, event: zenoh.LinkEvent) -> None:
        try:
            peer = str(event.link.zid)
            key = f"{event.link.src} {event.link.dst}"
            if event.kind == zenoh.SampleKind.PUT:
                found = _find(event.link.src, event.link.dst, self._files())
                if found is not None:
                    found.do_not_linger()
                with self._lock:
                    self._by_peer.setdefault(peer, {})[key] = found
            else:
                with self._lock:
                    link = self._by_peer.get(peer, {}).get(key)
                    if link is not None and not link.is_writable():
                        # Zenoh still tries to send for seconds, and blocks who sends more.
                        self._leaving.append((peer, key, link))
                    else:
                        self._forget(peer, key)
        except Exception:  # on a thread of Zenoh's
            log.exception("internal error after a link has changed")

    def _files(self) -> set[int]:
        with self._lock:
            links = [link for links in self._by_peer.values() for link in links.values()]
        return {link.fd for link in links if link is not None}

    def _forget_left(self) -> None:
        """Forget the leaving links whose socket is closed. Requires the lock."""
        for entry in self._leaving[:]:
            peer, key, link = entry
            if not link.is_open():
                self._leaving.remove(entry)
                self._forget(peer, key)

    def _forget(self, peer: str, key: str) -> None:
        """Requires the lock."""
        links = self._by_peer.get(peer, {})
        links.pop(key, None)
        if not links:
            self._by_peer.pop(peer, None)


def shut(src: str, dst: str) -> bool:
    """End the link between two endpoints: Zenoh finds it broken. False: its socket is not known."""
    found = _find(src, dst)
    return found is not None and found.shut()


def _find(src: str, dst: str, known: Collection[int] = ()) -> LinkSocket | None:
    """The socket between two endpoints such as ``tcp/127.0.0.1:7447``. `known`: the files of other
    links, which come last. Else the links of 1,000 clients took 20 s, in which the server could
    hardly do anything else."""
    ends = _address(src), _address(dst)
    if None in ends or not os.path.isdir(_OPEN_FILES):
        return None
    for fd in sorted(map(int, os.listdir(_OPEN_FILES)), key=known.__contains__):
        with contextlib.suppress(OSError, ValueError):
            status = os.fstat(fd)
            if stat.S_ISSOCK(status.st_mode) and _ends(fd) == ends:
                return LinkSocket(fd, status.st_ino)
    return None


def _address(endpoint: str) -> _Address | None:
    host, _, port = endpoint.partition("/")[2].partition("?")[0].rpartition(":")
    try:
        return _plain(host.strip("[]"), int(port))
    except ValueError:  # a path, or a name
        return None


def _plain(host: str, port: int) -> _Address:
    """One spelling of an address, also of an IPv4 address in an IPv6 one."""
    address = ipaddress.ip_address(host.partition("%")[0])
    mapped = getattr(address, "ipv4_mapped", None)
    return str(mapped or address), port


def _ends(fd: int) -> tuple[_Address | None, _Address | None]:
    """The addresses of a connection over TCP, its own and the other's; None for any other file."""
    kind = ctypes.c_int()
    size = ctypes.c_uint32(ctypes.sizeof(kind))
    status = _LIBC.getsockopt(
        fd, socket.SOL_SOCKET, socket.SO_TYPE, ctypes.byref(kind), ctypes.byref(size)
    )
    if status or kind.value != socket.SOCK_STREAM:
        return None, None
    return _name(_LIBC.getsockname, fd), _name(_LIBC.getpeername, fd)


def _name(function: Callable[..., int], fd: int) -> _Address | None:
    """One end of a socket; None if it is not one of IP, or not connected."""
    address = ctypes.create_string_buffer(128)  # sockaddr_storage
    size = ctypes.c_uint32(ctypes.sizeof(address))
    if function(fd, address, ctypes.byref(size)):
        return None
    family = int.from_bytes(address.raw[:2], sys.byteorder)
    if family not in (socket.AF_INET, socket.AF_INET6):
        return None
    host = address.raw[4:8] if family == socket.AF_INET else address.raw[8:24]
    return _plain(socket.inet_ntop(family, host), int.from_bytes(address.raw[2:4], "big"))
