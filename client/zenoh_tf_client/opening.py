"""Opens Zenoh sessions so that Ctrl-C is heard meanwhile.

Opening blocks in native code, which neither a signal nor another thread can interrupt. So a thread
opens the session while the caller waits in Python, in attempts that are short at first: the thread
of a caller that was interrupted ends with its attempt.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from typing import Final

import zenoh

from .session_calls import OPENING, note_zenoh_use

#: The first attempt's time; each further one takes twice as long, for slow networks.
_FIRST_ATTEMPT_S: Final = 1.0
_MIN_ATTEMPT_S: Final = 0.05
#: Zenoh's message after an attempt in which nobody answered; another attempt may succeed.
NOBODY_THERE: Final = "Unable to connect"


def open_session(config: Callable[[float], zenoh.Config], timeout_s: float) -> zenoh.Session:
    """Open a session with `config(attempt_s)`, trying for `timeout_s`.

    Raises:
        zenoh.ZError: The last attempt failed.
        ServerUnavailable: The program is ending, or its process was forked.
    """
    note_zenoh_use()
    opened: Future[zenoh.Session] = Future()
    thread = threading.Thread(
        target=_open, args=(config, timeout_s, opened), name="open session", daemon=True
    )
    with OPENING:  # in this thread: the error of a forked process needs no other
        thread.start()
    try:
        return opened.result()
    except BaseException:
        opened.cancel()  # the caller was interrupted: nobody takes the session
        raise


def _open(
    config: Callable[[float], zenoh.Config], timeout_s: float, opened: Future[zenoh.Session]
) -> None:
    deadline_s = time.monotonic() + timeout_s
    attempt_s = _FIRST_ATTEMPT_S
    while True:
        try:
            with OPENING:
                left_s = max(deadline_s - time.monotonic(), _MIN_ATTEMPT_S)
                session = zenoh.open(config(min(attempt_s, left_s)))
                # False: the caller has gone.
                if not opened.set_running_or_notify_cancel():
                    with contextlib.suppress(zenoh.ZError):
                        session.close()
                    return
            opened.set_result(session)
            return
        except BaseException as error:
            is_last = time.monotonic() >= deadline_s or NOBODY_THERE not in str(error)
            if opened.cancelled() or is_last:
                with contextlib.suppress(InvalidStateError):  # cancelled just now
                    opened.set_exception(error)
                return
        attempt_s *= 2
