"""Maps the server's tree, if the server is on this host and hands it over.

`MappedTree.tree` is that tree, or `NO_TREE`. A lookup calls its method there, and asks the server
if that returns an `AskServer`: so lookups succeed also when the server stops, is killed, or starts
again. A thread then maps the memory of the server that answers, and no lookup waits for it.

A lookup in memory takes a tenth of a microsecond, so the client keeps the tree in an attribute of
its own. No native function calls back to ask the server: a daemon thread that waits there while the
program ends would crash it (`_zenoh/calls`).

Thread safety: all methods.
"""

from __future__ import annotations

import logging
import threading
import weakref
from typing import Any, Final, Literal, Protocol, cast

from zenoh_tf import threads, unix
from zenoh_tf._core import ask_absent
from zenoh_tf._net import handover
from zenoh_tf._net.socket_trust import NotTrusted
from zenoh_tf._zenoh.calls import is_forked
from zenoh_tf.errors import InvalidArgumentException, TransformException
from zenoh_tf.shared_tree import AskServer, RegionRefused, SharedTree

from .connection import Connection
from .server_info import ServerInfo

Mode = Literal["shared", "query"]
MODES: Final = ("shared", "query")

#: How long a server may take to hand its tree over. It has just answered, so it mostly is quick.
_HANDOVER_S: Final = 2.0
#: How often the thread checks whether the mapped tree's lease has lapsed.
_PERIOD_S: Final = 1.0
#: Between two attempts to map the tree of a server, the first and the longest pause.
_RETRY_S: Final = 0.25
_MAX_RETRY_S: Final = 30.0
#: A tree whose lease has lapsed for so long is unmapped: its server has probably ended.
_LAPSED_S: Final = 3.0

#: Why no tree is mapped, and what it means; `stats` counts the attempts that ended so.
REASONS: Final = {
    "not_chosen": 'the client wants queries only (reads="query"), or has several endpoints',
    "not_offered": "the server does not share its memory",
    "other_host": "the server is on another host",
    "no_permission": "this user may not open the server's socket",
    "not_trusted": "another user could replace the server's socket",
    "other_layout": "the server has another version of zenoh-tf",
    "failed": "an attempt failed, and may succeed later",
}
_ASKED: Final = {
    AskServer.BUSY: "writers changed the links too often while they were read",
    AskServer.LAPSED: "the server has stopped or ended",
    AskServer.WAITING: "they wait for a transform",
    AskServer.UNREADABLE: "what the memory has could not be read",
    AskServer.ABSENT: "no memory was mapped",
}
#: What each counter of `MappedTree.stats` says.
COUNTERS: Final = {
    "reads_shared": "of this client: 1 if lookups read the server's memory now",
    "reads_mapped": "of this client: how often the server's memory was mapped",
    **{
        f"reads_asked_{why.name.lower()}": f"lookups of this client that asked the server: {text}"
        for why, text in _ASKED.items()
    },
    **{
        f"reads_refused_{why}": f"times that this client did not map the memory: {text}"
        for why, text in REASONS.items()
    },
}

log = logging.getLogger("zenoh_tf.client")


class _NoTree:
    """Stands for the server's memory where it is not mapped."""

    lease_left_s = 0.0

    def __getattr__(self, name: str) -> Any:
        setattr(self, name, ask_absent)  # the next call finds it at once
        return ask_absent


NO_TREE: Final = cast(SharedTree, _NoTree())


class Reader(Protocol):
    """What reads the tree: it has it as an attribute of its own."""

    _tree: SharedTree


class MappedTree:
    """The mapped tree of the server that a connection has."""

    def __init__(self, connection: Connection, mode: Mode = "shared") -> None:
        """Map the tree, if that is possible now.

        Raises:
            InvalidArgumentException: There is no such mode.
        """
        check(mode)
        #: Any thread may read it at any time.
        self.tree: SharedTree = NO_TREE
        self._connection = connection
        self._clients: weakref.WeakSet[Reader] = weakref.WeakSet()
        self._refused = dict.fromkeys(REASONS, 0)
        self._mapped = 0
        #: The server whose tree is mapped, or for good cannot be.
        self._settled: str | None = None
        self._logged = ""  # the state that was logged last
        self._lock = threading.Lock()
        self._wanted = threading.Event()
        self._closed = threading.Event()
        self._follows = False
        #: With several servers, memory does not say what the next one must have.
        self._is_on = mode == "shared" and len(connection.endpoints) == 1
        _all.add(self)
        if not self._is_on:
            self._refused["not_chosen"] += 1
            return
        server = connection.server
        if server is not None:
            self._map(server)
        connection.add_server_user(self)
        if self._settled is None or self.tree is not NO_TREE:
            self._follow()

    def attach(self, client: Reader) -> None:
        """Let a client always have the tree as `_tree`."""
        with self._lock:
            self._clients.add(client)
            client._tree = self.tree

    @property
    def in_use(self) -> Mode:
        """How a lookup would be answered now."""
        return "shared" if self.tree.lease_left_s > 0 else "query"

    def server_changed(self) -> None:
        """Let the thread map the tree of a new server, if there is one."""
        if self._is_on:
            self._follow()
            self._wanted.set()

    def stats(self) -> dict[str, int]:
        """The counters of this client: how it reads, how often not so, and why."""
        counts = {"shared": int(self.in_use == "shared"), "mapped": self._mapped}
        asked = self._connection.asked
        counts |= {f"asked_{why.name.lower()}": asked[why] for why in AskServer}
        counts |= {f"refused_{why}": count for why, count in self._refused.items()}
        return {f"reads_{name}": count for name, count in counts.items()}

    def close(self) -> None:
        """Unmap the tree for good."""
        if is_forked():
            return
        with self._lock:
            self._closed.set()
            self._install(NO_TREE)
        self._wanted.set()

    def update(self) -> bool:
        """Map the tree of a server that is new, and unmap one that has ended. False: to be
        repeated."""
        wanted = self._wanted.is_set()
        self._wanted.clear()
        tree = self.tree
        if tree is not NO_TREE and tree.lease_left_s > 0:
            self._log_state(f"lookups read the memory of server {tree.instance}")
            if self._connection.known_instance in (None, self._settled):
                return True
        elif tree is not NO_TREE:
            self._log_state(
                "lookups are queries: the server has stopped or ended (its lease lapsed)"
            )
            if tree.lease_left_s < -_LAPSED_S:
                self._set(NO_TREE)
                self._settled = None
                wanted = True  # it may only have stopped
        if not wanted:
            return True
        try:
            server = self._connection.hello()
        except TransformException:
            return True  # a lookup that it answers again reports it
        if server.instance == self._settled:
            return True
        self._map(server)
        if self._settled is None:
            self._wanted.set()
        return self._settled is not None

    def _map(self, server: ServerInfo) -> None:
        """Map the tree of a server, or log why not."""
        offer = server.offer
        if offer is None:
            self._refuse(server, "not_offered", "the server does not offer its memory")
            return
        if offer.host != handover.boot_id():
            self._refuse(server, "other_host", "the server is on another host")
            return
        try:
            tree = handover.receive(offer, self._connection.tree, server.instance, _HANDOVER_S)
        except NotTrusted as error:
            self._refuse(server, "not_trusted", f"{offer.socket}: {error.strerror}")
        except PermissionError:
            self._refuse(server, "no_permission", f"no permission to open {offer.socket}")
        except RegionRefused as error:
            self._refuse(server, "other_layout", str(error))
        except (OSError, TransformException) as error:
            self._refuse(server, "failed", f"{offer.socket}: {error}")
        else:
            self._set(tree)
            self._settled = server.instance
            self._mapped += 1
            self._log_state(f"lookups read the memory of server {server.instance}")

    def _refuse(self, server: ServerInfo, why: str, text: str) -> None:
        self._set(NO_TREE)
        self._refused[why] += 1
        self._settled = None if why == "failed" else server.instance
        self._log_state(f"lookups are queries: {text}")

    def _set(self, tree: SharedTree) -> None:
        with self._lock:
            if self._closed.is_set():
                return
            self._install(tree)

    def _install(self, tree: SharedTree) -> None:
        self.tree = tree
        for client in self._clients:
            client._tree = tree

    def _log_state(self, state: str) -> None:
        if state != self._logged:
            self._logged = state
            log.info("%s (tree %r)", state, self._connection.tree)

    def _follow(self) -> None:
        if self._follows:
            return
        with self._lock:
            if self._follows or self._closed.is_set():
                return
            self._follows = True
        threads.start("shared reads", _follow, weakref.ref(self), self._wanted, self._closed)


def check(mode: str) -> None:
    """Raise InvalidArgumentException if there is no such mode."""
    if mode not in MODES:
        choices = " or ".join(map(repr, MODES))
        raise InvalidArgumentException(f"reads must be {choices}, not {mode!r}", field="reads")


def _follow(
    reads_ref: weakref.ref[MappedTree], wanted: threading.Event, closed: threading.Event
) -> None:
    """Keep the mapped tree up to date, until its client is closed or collected."""
    pause_s = _RETRY_S
    while not closed.is_set():
        wanted.wait(_PERIOD_S)
        reads = reads_ref()
        if reads is None or closed.is_set():
            return
        try:
            done = reads.update()
        except Exception:  # no error may end it
            log.exception("internal error while mapping the server's tree")
            done = False
        del reads  # or the pause would keep it alive
        pause_s = _RETRY_S if done else min(2 * pause_s, _MAX_RETRY_S)
        closed.wait(pause_s)


_all: weakref.WeakSet[MappedTree] = weakref.WeakSet()


def _after_fork() -> None:
    """In a forked child: every call fails, as the connection does not work there."""
    for reads in list(_all):
        reads._install(NO_TREE)
        reads._is_on = False


unix.after_fork(_after_fork)
