"""Whether a Unix socket can be another user's: its readers trust the owner.

Thread safety: all functions.

Internal: for `zenoh_tf_server`, which makes such sockets, and `zenoh_tf_client`, which opens them.
"""

from __future__ import annotations

import errno
import os
import socket
import stat
import struct
from collections.abc import Collection
from typing import Final

_ROOT: Final = 0
_WRITABLE: Final = stat.S_IWGRP | stat.S_IWOTH
_PEER: Final = struct.Struct("3i")  # process, user and group


class NotTrusted(OSError):
    """Somebody else may have made or replaced a socket."""

    def __init__(self, reason: str) -> None:
        super().__init__(errno.EPERM, reason)


def check_folder(folder: str | os.PathLike[str], owners: Collection[int]) -> None:
    """Check that only root and `owners` can replace a socket in a folder, or a folder above it.

    Where the sticky bit is set, as in /tmp, others may add names, but replace none.

    Raises:
        NotTrusted: Others can.
        OSError: The folder cannot be examined.
    """
    each = os.path.realpath(folder)
    above = ""
    while each != above:
        status = os.stat(each)
        mode = stat.S_IMODE(status.st_mode)
        if status.st_uid != _ROOT and status.st_uid not in owners:
            raise NotTrusted(f"{each} belongs to another user (uid {status.st_uid})")
        if mode & _WRITABLE and not mode & stat.S_ISVTX:
            raise NotTrusted(f"others may write to {each} (mode {mode:04o}): chmod go-w {each}")
        each, above = os.path.dirname(each), each


def check_peer(peer: socket.socket, path: str) -> None:
    """Check that a connection is to a process of root, of this user, or of the owner of the
    socket's folder, and that no other user can have put a socket there.

    Raises:
        NotTrusted: It is not.
        OSError: The folder cannot be examined.
    """
    folder = os.path.dirname(path) or "."
    owners = {os.geteuid(), os.stat(folder).st_uid}
    check_folder(folder, owners)
    # Of the process that listens, whatever became of the name since.
    _, user, _ = _PEER.unpack(peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))
    if user != _ROOT and user not in owners:
        raise NotTrusted(f"{path} is the socket of another user (uid {user})")
