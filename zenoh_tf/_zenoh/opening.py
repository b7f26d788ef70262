"""Opens a session so that Ctrl-C is heard.

`zenoh.open` blocks in native code. Python's documentation of `signal` says of that: it "may run
uninterrupted for an arbitrary amount of time, regardless of any signals received". So a thread
makes the attempt while the caller waits in Python. The thread of a caller that was interrupted ends
with its attempt, and a program that ends waits for it.
"""

from __future__ import annotations

import contextlib
from concurrent.futures import Future, InvalidStateError

import zenoh

from .. import threads
from .calls import OPENING, record_zenoh_use


def open_session(config: zenoh.Config) -> zenoh.Session:
    """Open a session, on another thread.

    Raises:
        zenoh.ZError: It cannot be opened.
        ServerUnavailable: The program is ending, or its process was forked.
    """
    record_zenoh_use()
    opened: Future[zenoh.Session] = Future()
    try:
        with OPENING:  # in this thread: the error of a forked process needs no other
            threads.start("open session", _open, config, opened)
        return opened.result()
    except BaseException:
        opened.cancel()  # if the caller was interrupted, nobody uses the session
        raise


def _open(config: zenoh.Config, opened: Future[zenoh.Session]) -> None:
    try:
        with OPENING:
            session = zenoh.open(config)
            if not opened.set_running_or_notify_cancel():  # the caller has gone
                with contextlib.suppress(zenoh.ZError):
                    session.close()
                return
        opened.set_result(session)
    except BaseException as error:
        with contextlib.suppress(InvalidStateError):  # the caller has gone
            opened.set_exception(error)
