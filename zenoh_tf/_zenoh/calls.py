"""Keeps threads out of Zenoh while the interpreter ends.

A thread that returns from native code during Python's finalization is ended by `pthread_exit`.
That unwinds through Zenoh's Rust frames and aborts the process (PyO3/pyo3#4874). Of Python 3.14 the
documentation of `PyEval_RestoreThread` says: "Hangs the current thread, rather than terminating it,
if called while the interpreter is finalizing." Before, each call into a Zenoh session must be left
by then: it runs inside the session's `SessionCalls`, and opening one inside `OPENING`. An exit
handler, which runs before finalization, closes all sessions that are still open and waits until no
thread is inside a call.

Zenoh's threads do not exist in a child that was forked from a process with a session, and Zenoh's
calls wait there for ever. So there every call fails at once, and nothing that belongs to Zenoh is
closed or freed.

Thread safety: all functions and methods.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import threading
import time
import weakref
from collections.abc import Callable
from types import TracebackType

import zenoh

from .. import threads, unix
from ..errors import ServerUnavailable

#: How long the exit handler waits for calls to return before it gives up: a session that the
#: server does not let close takes 10 s.
_EXIT_TIMEOUT_S = 11.0
#: How long a caller waits until its session has closed, before it is left to close by itself.
_CLOSE_TIMEOUT_S = 2.0
#: How long a daemon thread sleeps, after the sessions were closed at exit, before it learns that.
#: The process usually ends before, so that the thread prints no traceback.
_PAUSE_AT_EXIT_S = 1.0

_all: weakref.WeakSet[SessionCalls] = weakref.WeakSet()
_all_lock = threading.Lock()
#: Those that were closed and may have a thread inside. The garbage collector clears weak references
#: before it calls `__del__`, which closes. No lock: the collector may run while one is held.
_closing: set[SessionCalls] = set()
#: True once this process has begun to open a session.
_zenoh_was_used = False
#: True in a child that was forked after this process had used Zenoh.
_forked = False
_FORKED_MESSAGE = (
    "this process was forked from one that had connected: Zenoh does not work in it; start "
    "processes with multiprocessing's 'spawn' method, or fork before the first connection"
)
_exiting = False  # the exit handler has begun
_all_closed = threading.Event()


class SessionCalls:
    """The calls that are inside one Zenoh session.

    A context manager around each such call: raises ServerUnavailable if the session is closed.
    """

    def __init__(
        self, close_session: Callable[[], object], closed_message: str = "the connection is closed"
    ) -> None:
        self._close_session = close_session
        self._closed_message = closed_message
        # A signal handler may close the client while its thread is in here, hence reentrant.
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._inside = 0
        self._closed = False
        self._owners: weakref.WeakSet[object] = weakref.WeakSet()
        with _all_lock:
            _all.add(self)

    def __enter__(self) -> None:
        if _forked:  # before the lock
            raise_if_forked()
        with self._lock:
            if not self._closed and not (_exiting and _is_daemon_at_exit()):
                self._inside += 1
                return
        _pause_at_exit()
        raise ServerUnavailable(self._closed_message)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._lock:
            self._inside -= 1
            if self._closed and self._inside == 0:
                self._changed.notify_all()
        if _exiting:
            _pause_at_exit()

    def add_owner(self, owner: object) -> None:
        """Record an object that has objects of Zenoh's: a forked child must not free them."""
        self._owners.add(owner)

    def never_free(self) -> None:
        """Leak the session and what its owners have: to free them waits for Zenoh's threads."""
        for leaked in (self, *self._owners):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(leaked))

    @property
    def closed(self) -> bool:
        """True once `close` was called."""
        return self._closed

    def close(self) -> None:
        """Close the session; calls that are inside fail soon. May be called again."""
        if _forked:
            return
        if self._closed:
            return
        _closing.add(self)  # then the exit handler waits for it, or it is seen to have begun
        if _is_daemon_at_exit():
            self.never_free()  # the exit handler closes what it knows of
            return
        with self._changed:
            if self._closed:
                if self._inside == 0:
                    _closing.discard(self)
                return
            self._closed = True
            self._inside += 1  # the exit handler waits for it, too
        if _exiting:  # no thread can be started any more
            self._close()
            return
        # Zenoh retries for 10 s if the server does not accept what is still to be sent.
        # Another thread waits for that, because it cannot be interrupted.
        threads.join(threads.start("close session", self._close), timeout_s=_CLOSE_TIMEOUT_S)

    def _close(self) -> None:
        try:
            with contextlib.suppress(zenoh.ZError):
                self._close_session()
        finally:
            if not _exiting:
                _closing.discard(self)
            self.__exit__(None, None, None)

    def wait_until_none(self, timeout_s: float) -> None:
        """Wait until no call is inside, or for `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._inside == 0, timeout_s)


#: The calls that open sessions. Zenoh cannot interrupt them, so at exit they are waited for.
OPENING = SessionCalls(lambda: None, "the program is ending")


def is_forked() -> bool:
    """True in a child that was forked after its parent had used Zenoh. Any lock may be held for
    ever there, by a thread that only the parent has."""
    return _forked


def raise_if_forked() -> None:
    """Raise ServerUnavailable in such a child; to be called before any lock is taken."""
    if _forked:
        raise ServerUnavailable(_FORKED_MESSAGE)


def record_zenoh_use() -> None:
    """To be called before the process uses Zenoh: from then on its forked children must not."""
    global _zenoh_was_used  # noqa: PLW0603
    _zenoh_was_used = True


def _is_daemon_at_exit() -> bool:
    """At exit, all threads but the main one are daemons, or have ended."""
    return _exiting and threading.current_thread() is not threading.main_thread()


def _pause_at_exit() -> None:
    """At exit, hold a daemon thread in Python, where finalization may safely end it."""
    if _is_daemon_at_exit():
        _all_closed.wait()
        time.sleep(_PAUSE_AT_EXIT_S)


@atexit.register
def _close_all() -> None:
    """Close every open session, and wait until all threads have left them."""
    global _exiting  # noqa: PLW0603
    if _forked:
        return
    _exiting = True
    with _all_lock:
        all_calls = list(_all)
    all_calls = list(dict.fromkeys([*all_calls, *list(_closing)]))
    for calls in all_calls:
        calls.close()
    deadline_s = time.monotonic() + _EXIT_TIMEOUT_S
    for calls in all_calls:
        calls.wait_until_none(max(0.0, deadline_s - time.monotonic()))
    _all_closed.set()


def _after_fork() -> None:
    """In a forked child: let no call reach Zenoh, and free none of its objects."""
    global _forked  # noqa: PLW0603
    if not _zenoh_was_used:
        return
    _forked = True
    for calls in list(_all):
        calls.never_free()


unix.after_fork(_after_fork)
