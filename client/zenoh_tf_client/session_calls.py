"""Keeps threads out of Zenoh while the interpreter ends.

A thread that returns from native code during Python's finalization is ended by `pthread_exit`.
That unwinds through Zenoh's Rust frames and aborts the process. So each call into a Zenoh session
runs inside the session's `SessionCalls`, and opening one inside `OPENING`. An exit handler, which
runs before finalization, closes all sessions that are still open and waits until no thread is
inside a call.

Thread safety: all functions and methods.
"""

from __future__ import annotations

import atexit
import contextlib
import threading
import time
import weakref
from collections.abc import Callable
from types import TracebackType

import zenoh

from zenoh_tf.errors import ServerUnavailable

#: How long the exit handler waits for calls to return before it gives up.
_EXIT_TIMEOUT_S = 2.0
#: How long a daemon thread sleeps, after the sessions were closed at exit, before it learns that.
#: The process usually ends before, so that the thread prints no traceback.
_PAUSE_AT_EXIT_S = 1.0

_all: weakref.WeakSet[SessionCalls] = weakref.WeakSet()
_all_lock = threading.Lock()
_exiting = threading.Event()
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
        self._changed = threading.Condition(threading.RLock())
        self._inside = 0
        self._closed = False
        with _all_lock:
            _all.add(self)

    def __enter__(self) -> None:
        with self._changed:
            if not self._closed and not _is_daemon_at_exit():
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
        with self._changed:
            self._inside -= 1
            if self._closed and self._inside == 0:
                self._changed.notify_all()
        _pause_at_exit()

    @property
    def closed(self) -> bool:
        """True once `close` was called."""
        return self._closed

    def close(self) -> None:
        """Close the session; calls that are inside fail soon. May be called again."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
        # Zenoh gives up after 10 s if the server does not take what is still to be sent.
        with contextlib.suppress(zenoh.ZError):
            self._close_session()

    def wait_until_none(self, timeout_s: float) -> None:
        """Wait until no call is inside, or for `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._inside == 0, timeout_s)


#: The calls that open sessions. Zenoh cannot interrupt them, so at exit they are waited for.
OPENING = SessionCalls(lambda: None, "the program is ending")


def _is_daemon_at_exit() -> bool:
    """At exit, all threads but the main one are daemons, or have ended."""
    return _exiting.is_set() and threading.current_thread() is not threading.main_thread()


def _pause_at_exit() -> None:
    """At exit, hold a daemon thread in Python, where finalization may safely end it."""
    if _is_daemon_at_exit():
        _all_closed.wait()
        time.sleep(_PAUSE_AT_EXIT_S)


@atexit.register
def _close_all() -> None:
    """Close every open session, and wait until all threads have left them."""
    _exiting.set()
    with _all_lock:
        still_open = [calls for calls in _all if not calls.closed]
    for calls in still_open:
        calls.close()
    deadline_s = time.monotonic() + _EXIT_TIMEOUT_S
    for calls in still_open:
        calls.wait_until_none(max(0.0, deadline_s - time.monotonic()))
    _all_closed.set()
