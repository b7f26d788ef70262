"""Shares the server's tree with clients of the same host, who map its memory.

The tree is in a region of memory, whose file descriptor every client gets that may open a Unix
socket (`zenoh_tf._net.handover`). Clients trust what they read while the region's lease is valid,
which a thread of the core extends as long as the process lives and runs (core/shared/lease.hpp).

No answer may come from this tree once a successor has accepted a write. The successor listens where
this server did, so it can only start when this process has ended: a server that joins an existing
network can have a successor earlier, and shares nothing. And each server waits at its start until
the lease of a predecessor must have lapsed (`wait_for_predecessor`).

A client sends nothing, and nothing of its connection is kept.

Thread safety: construction and `close` by one thread.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import os
import re
import shutil
import socket
import stat
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from zenoh_tf import TransformTree, threads
from zenoh_tf._core import LeaseKeeper
from zenoh_tf._net import handover
from zenoh_tf._net.socket_trust import check_folder
from zenoh_tf.text import quoted

from ..flag_table import flag
from .network import NetworkError

_GROUP: Final = "clients on the same host, who read the tree's memory"
#: The lease of core/shared/lease.hpp.
LEASE_S: Final = 0.25
_BACKLOG: Final = 64
#: After an error that may last, such as too many open files.
_PAUSE_S: Final = 0.1
_SEND_TIMEOUT_S: Final = 1.0
#: Sockets of other servers that a server checks when it starts.
_MOST_STALE: Final = 1000
_UNSAFE: Final = re.compile(r"[^A-Za-z0-9_-]")
#: The names of servers' sockets: the tree, the instance, and the number of a replica's copy.
_OURS: Final = re.compile(r"[A-Za-z0-9_-]{1,40}-[0-9a-f]{16}(?:-[0-9]+)?\.sock")

log = logging.getLogger("zenoh_tf.server.sharing")


@dataclass(frozen=True)
class SharingSettings:
    """From the flags of sharing."""

    folder: Path | None = flag(
        "--share-dir",
        None,
        "folder of their socket (default: zenoh-tf in $XDG_RUNTIME_DIR, else /run/zenoh-tf)",
        group=_GROUP,
        type=Path,
        metavar="DIR",
    )
    group: str | None = flag(
        "--share-group",
        None,
        "who may read, too (default: only the server's user)",
        group=_GROUP,
        metavar="GROUP",
    )
    off: bool = flag(
        "--no-share", False, "nobody reads the memory; all reads are queries", group=_GROUP
    )
    #: How long a predecessor may have a lease after it has lost the endpoints.
    predecessor_s: float = LEASE_S

    @property
    def required(self) -> bool:
        """True if the server must not start without sharing its tree."""
        return self.folder is not None or self.group is not None


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if the flags do not fit together."""
    for dest in ("share_dir", "share_group"):
        if getattr(options, dest) is None:
            continue
        name = "--" + dest.replace("_", "-")
        if options.no_share:
            parser.error(f"{name} and --no-share exclude each other")
        if options.connect:
            parser.error(f"{name}: a server with --connect does not share its tree")


class Sharing:
    """The shared memory and the socket of one server's tree."""

    def __init__(
        self,
        settings: SharingSettings,
        tree: str,
        instance: str,
        *,
        joined: bool = False,
        owner: str | None = None,
    ) -> None:
        """Make the socket, which nobody can open before `start`.

        `joined`: the server is a client of an existing network. `owner`: its socket differs from
        those of other owners of the same instance's tree.

        Raises:
            NetworkError: Sharing is required, and there can be no socket.
        """
        self._settings = settings
        self._tree_name = tree
        self._instance = instance
        self._owner = owner or instance
        self._listener: socket.socket | None = None
        self._path: Path | None = None
        self._keeper: LeaseKeeper | None = None
        self._closed = False
        if settings.off:
            return
        if joined:
            log.info("the tree is not shared: the server joined a network (--connect)")
            return
        try:
            self._listen()
        except (OSError, LookupError) as error:
            self._give_up(error)

    def make_tree(self, make: Callable[..., TransformTree]) -> TransformTree:
        """The server's tree, in shared memory if that is possible. `make` accepts the options of
        TransformTree that say so.

        Raises:
            NetworkError: Sharing is required, and there can be no shared memory.
        """
        if self._listener is None:
            return make()
        try:
            return make(_shared=True, _instance=self._instance)
        except OSError as error:
            self._give_up(error)
            return make()

    def start(self, tree: TransformTree, limits: dict[str, int]) -> handover.Offer | None:
        """Begin the lease and hand the tree over. Call it when no predecessor can have a lease.
        Returns what `hello` says of it; None if the tree is not shared."""
        listener, path = self._listener, self._path
        if listener is None or path is None:
            return None
        self._keeper = LeaseKeeper(tree)
        hello = handover.message(self._tree_name, self._instance, limits, tree._motion_limits())
        threads.start("share", self._hand_over, listener, hello, tree)
        final = path.with_suffix(handover.SUFFIX)
        path.rename(final)
        self._path = final
        log.info("clients on this host can read the tree's memory: %s", final)
        return handover.Offer(handover.boot_id(), str(final))

    def close(self) -> None:
        """End the lease and remove the socket. May be called again."""
        self._closed = True
        keeper, self._keeper = self._keeper, None
        if keeper is not None:
            keeper.end()
        listener, self._listener = self._listener, None
        if listener is not None:
            with contextlib.suppress(OSError):  # wakes the thread up
                listener.shutdown(socket.SHUT_RDWR)
            listener.close()
        path, self._path = self._path, None
        if path is not None:
            path.unlink(missing_ok=True)

    def _listen(self) -> None:
        if not handover.boot_id():
            raise OSError(errno.ENOSYS, "the system does not say which host it is")
        folder = self._folder()
        _remove_stale(folder)
        # Under another name at first: another server that starts must not regard it as stale.
        name = f"{_UNSAFE.sub('_', self._tree_name)[:40]}-{self._owner}.new"
        path = folder / name
        if len(os.fsencode(path.with_suffix(handover.SUFFIX))) >= handover.MAX_PATH_BYTES:
            raise OSError(errno.ENAMETOOLONG, f"the path of the socket is too long: {path}")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._path = path
        self._listener.bind(str(path))
        path.chmod(0o600 if self._settings.group is None else 0o660)
        if self._settings.group is not None:
            shutil.chown(path, group=self._settings.group)
        self._listener.listen(_BACKLOG)

    def _folder(self) -> Path:
        """The folder of the socket, which is made if it does not exist."""
        settings = self._settings
        default = map(Path, handover.default_folders())
        folders = list(default) if settings.folder is None else [settings.folder]
        if settings.group is not None:  # no group can enter $XDG_RUNTIME_DIR
            folders = folders[-1:]
        failure: OSError | None = None
        for folder in folders:
            try:
                is_new = not folder.exists()
                folder.mkdir(mode=0o700, exist_ok=True)
                if is_new and settings.group is not None:
                    shutil.chown(folder, group=settings.group)
                    folder.chmod(0o750)
                check_folder(folder, {os.geteuid()})
                if os.access(folder, os.W_OK | os.X_OK):
                    return folder.absolute()
                failure = PermissionError(errno.EACCES, f"cannot write to {folder}")
            except OSError as error:
                failure = error
        assert failure is not None
        raise failure

    def _give_up(self, error: Exception) -> None:
        self.close()
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        name = f": {error.filename}" if isinstance(error, OSError) and error.filename else ""
        if self._settings.required:
            raise NetworkError(f"cannot share the tree: {reason}{name}") from error
        log.info("the tree is not shared, clients read by queries: %s%s", reason, name)

    def _hand_over(self, listener: socket.socket, hello: bytes, tree: TransformTree) -> None:
        while not self._closed:
            try:
                peer, _ = listener.accept()
            except OSError as error:
                if self._closed:
                    return
                log.warning("cannot hand the tree over: %s", error)
                time.sleep(_PAUSE_S)
                continue
            with peer, contextlib.suppress(OSError):  # the client has gone, or reads no more
                peer.settimeout(_SEND_TIMEOUT_S)
                socket.send_fds(peer, [hello], [tree._region_fd()])


def wait_for_predecessor(settings: SharingSettings, listens_since_s: float) -> None:
    """Wait until the lease of a predecessor must have lapsed, which had the server's endpoints
    until `listens_since_s` (of the monotonic clock) at most."""
    time.sleep(max(0.0, listens_since_s + settings.predecessor_s - time.monotonic()))


def _remove_stale(folder: Path) -> None:
    """Remove the sockets of this user's servers that were killed: nobody listens on them."""
    for number, path in enumerate(folder.glob("*" + handover.SUFFIX)):
        if number == _MOST_STALE:
            return
        if not _is_ours(path):
            continue
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            probe.setblocking(False)
            try:
                probe.connect(str(path))
            except ConnectionRefusedError:
                with contextlib.suppress(OSError):
                    path.unlink()
                    log.debug("removed the socket of a server that is gone: %s", quoted(path.name))
            except OSError:
                continue


def _is_ours(path: Path) -> bool:
    """Whether a file is the socket of a server of this user."""
    if not _OURS.fullmatch(path.name):
        return False
    try:
        status = path.lstat()
    except OSError:
        return False
    return stat.S_ISSOCK(status.st_mode) and status.st_uid == os.geteuid()
