"""How a server hands its shared tree over to clients of the same host, through a Unix socket.

A client connects, and the server sends one message with the file descriptor of its region, and
closes the connection. docs/reference/protocol.md describes the message.

Internal: for `zenoh_tf_server`, which sends, and `zenoh_tf_client`, which receives.
"""

from __future__ import annotations

import os
import socket
import stat
import struct
import time
from dataclasses import dataclass
from typing import Final

from zenoh_tf import wire
from zenoh_tf._core import LAYOUT
from zenoh_tf._net.socket_trust import check_peer
from zenoh_tf.shared_tree import RegionRefused, SharedTree

SUFFIX: Final = ".sock"
#: What `hello` says of a shared tree is in this field.
HELLO_FIELD: Final = "share"
_LENGTH: Final = struct.Struct("<I")
_MAX_BYTES: Final = 1 << 16
#: Longest path of a Unix socket, with the zero byte at its end.
MAX_PATH_BYTES: Final = 108
_RETRY_S: Final = 0.005
_CLOSE_ON_EXEC: Final = getattr(socket, "MSG_CMSG_CLOEXEC", 0)


@dataclass(frozen=True, slots=True)
class Offer:
    """Where a server hands its tree over."""

    host: str  # the boot id: another one cannot map the server's memory
    socket: str  # the path, as the server sees it

    def fields(self) -> wire.Message:
        return {"host": self.host, "socket": self.socket}


def boot_id() -> str:
    """Identifies this host since its last start; empty if the system does not say."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="utf-8") as file:
            return file.read().strip()
    except OSError:
        return ""


def default_folders() -> list[str]:
    """Where servers put their sockets by default: the first one that can be made."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    own = [os.path.join(runtime, "zenoh-tf")] if runtime and os.path.isabs(runtime) else []
    return [*own, "/run/zenoh-tf"]


def message(
    tree: str,
    instance: str,
    limits: dict[str, int],
    motion_limits: wire.MotionLimits | None = None,
) -> bytes:
    """What a server sends together with the file descriptor."""
    version, layout_hash = LAYOUT
    payload = wire.pack(
        {
            "v": wire.VERSION,
            "layout": [version, layout_hash],
            "tree": tree,
            "instance": instance,
            "limits": limits,
        }
        | wire.motion_limits_fields(motion_limits or {})
    )
    return _LENGTH.pack(len(payload)) + payload


def parse_offer(value: object) -> Offer | None:
    """The offer in the reply to `hello`; None if there is no valid one."""
    if not isinstance(value, dict):
        return None
    host, path = value.get("host"), value.get("socket")
    if not isinstance(host, str) or not isinstance(path, str):
        return None
    if not path.startswith("/") or "\0" in path:
        return None
    return Offer(host, path)


def receive(offer: Offer, tree: str, instance: str, timeout_s: float) -> SharedTree:
    """Map the tree of a server instance on this host.

    Raises:
        OSError: The socket cannot be reached, or nothing came within `timeout_s`.
        NotTrusted: It may be another user's; an OSError.
        RegionRefused: What the socket's owner sent is not the tree, or cannot be read here.
        ProtocolError: What it sent is malformed.
    """
    fd, motion_limits = _greeting(offer, tree, instance, timeout_s)
    try:
        shared = SharedTree(fd)
    finally:
        os.close(fd)
    for child, limits in motion_limits.items():
        shared._set_motion_limits(child, *limits)
    return shared


def _greeting(
    offer: Offer, tree: str, instance: str, timeout_s: float
) -> tuple[int, wire.MotionLimits]:
    """The file descriptor and the limits of motion that a server instance sends.

    In a container, the socket's folder may be mounted elsewhere than at the server's path. So the
    default folders are searched for the socket as well.
    """
    paths = [offer.socket]
    name = os.path.basename(offer.socket)
    paths += [os.path.join(folder, name) for folder in default_folders()]
    path = next((path for path in paths if _is_socket(path)), offer.socket)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as peer:
        payload, fd = _receive(peer, path, timeout_s)
    try:
        message = wire.unpack(payload)
        layout = message.get("layout")
        if layout != list(LAYOUT):
            raise RegionRefused(
                f"the server's tree has the memory layout {_layout(layout)}, and this client reads "
                f"{_layout(LAYOUT)}: install the same version of zenoh-tf in both"
            )
        if (wire.text(message, "tree"), wire.text(message, "instance")) != (tree, instance):
            raise RegionRefused(f"{path} belongs to another server")
        return fd, wire.parse_motion_limits(message)
    except BaseException:
        os.close(fd)
        raise


def _layout(layout: object) -> str:
    match layout:
        case (int(version), int(layout_hash)):
            return f"{version} ({layout_hash:016x})"
    return "(unknown)"


def _is_socket(path: str) -> bool:
    try:
        return stat.S_ISSOCK(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def _connect(peer: socket.socket, path: str, deadline_s: float) -> None:
    """Connect, also while many others do: then the kernel refuses at first."""
    peer.setblocking(False)
    while True:
        try:
            return peer.connect(path)
        except BlockingIOError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(_RETRY_S)


def _receive(peer: socket.socket, path: str, timeout_s: float) -> tuple[bytes, int]:
    """Connect, and return the payload and the file descriptor that the socket's owner sends."""
    deadline_s = time.monotonic() + timeout_s
    fds: list[int] = []
    try:
        data = b""
        wanted = _LENGTH.size
        _connect(peer, path, deadline_s)
        check_peer(peer, path)
        while len(data) < wanted:
            peer.settimeout(max(deadline_s - time.monotonic(), 0.001))
            more, received, _, _ = socket.recv_fds(peer, wanted - len(data), 4, _CLOSE_ON_EXEC)
            fds += received
            if not more:
                raise ConnectionResetError(f"{path}: the connection ended early")
            data += more
            if len(data) == _LENGTH.size:
                length = _LENGTH.unpack(data)[0]
                if length > _MAX_BYTES:
                    raise RegionRefused(f"{path} does not belong to a server of zenoh-tf")
                wanted += length
        if len(fds) != 1:
            raise RegionRefused(f"{path} sent {len(fds)} file descriptors instead of one")
        return data[_LENGTH.size :], fds.pop()
    finally:
        for fd in fds:
            os.close(fd)
