"""Opens the Zenoh session of a client, and finds out why if that fails.

Opening blocks in native code, which neither a signal nor another thread can interrupt. So a thread
makes each attempt while the caller waits in Python, where Ctrl-C is heard. No attempt is long: the
thread of a caller that was interrupted ends with its attempt, and a program that ends waits for it.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from concurrent.futures import Future, InvalidStateError
from typing import Final

import zenoh

from zenoh_tf import threads, wire
from zenoh_tf._net import connect_failure, zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable
from zenoh_tf.mirrors.free_memory import limit_heaps

from .calls import OPENING, record_zenoh_use

#: The first attempt's time; the others take longer, for slow networks.
_FIRST_ATTEMPT_S: Final = 1.0
_MAX_ATTEMPT_S: Final = 3.0
_MIN_ATTEMPT_S: Final = 0.05
#: The same for each of several endpoints. A session keeps the time in which it was opened for its
#: later attempts, so that it does not wait long for an endpoint that is gone.
_FIRST_OF_SEVERAL_S: Final = 0.25
#: Between two rounds of attempts at several endpoints.
_ROUND_PAUSE_S: Final = 0.05
#: Zenoh tries again this soon after a lost connection, then ever slower up to the maximum. It does
#: so within an attempt, too.
_RETRY: Final = {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2}
#: Zenoh's message after an attempt in which nobody answered; another attempt may succeed.
_NOBODY_THERE: Final = "Unable to connect"


def open_session(
    endpoints: Sequence[str], tree: str, timeout_s: float, credentials: Credentials
) -> zenoh.Session:
    """Open a session with the first of `endpoints` that lets this client in, trying for
    `timeout_s`.

    Looks for the reason of a failure after the first attempt, so that a server that does not let
    this client in is not asked again, and once more at the end.

    Raises:
        ServerUnavailable: Nobody opened a session in time, the program is ending, or its process
            was forked.
        AccessDenied: The server does not let this client in, or cannot be trusted.
        InvalidArgumentException: An endpoint or `credentials` is invalid.
    """
    record_zenoh_use()
    deadline_s = time.monotonic() + timeout_s
    attempt_s = _FIRST_ATTEMPT_S if len(endpoints) == 1 else _FIRST_OF_SEVERAL_S
    is_first = True
    while True:
        begin_s = time.monotonic()
        left_s = max(deadline_s - begin_s, _MIN_ATTEMPT_S)
        try:
            return try_session(endpoints, min(attempt_s, left_s), credentials)
        except zenoh.ZError as error:
            if _NOBODY_THERE not in str(error):
                raise InvalidArgumentException(
                    f"endpoint {zenoh_config.addresses(endpoints)!r}: "
                    f"{str(error).split(' at /', maxsplit=1)[0]}",
                    field="endpoint",
                ) from error
            if is_first or time.monotonic() >= deadline_s:
                failure = connect_failure.explain_all(endpoints, tree, timeout_s, credentials)
                is_final = not isinstance(failure, ServerUnavailable)
                if is_final or time.monotonic() >= deadline_s:
                    raise failure from None  # Zenoh's error says less
        is_first = False
        if len(endpoints) == 1 or time.monotonic() - begin_s >= attempt_s:  # it was too short
            attempt_s = min(2 * attempt_s, _MAX_ATTEMPT_S)
        if len(endpoints) > 1:
            time.sleep(_ROUND_PAUSE_S)


def try_session(
    endpoints: Sequence[str], attempt_s: float, credentials: Credentials
) -> zenoh.Session:
    """Open a session in one attempt, on another thread.

    Raises:
        zenoh.ZError: Nobody opened one within `attempt_s`, or an endpoint is invalid.
        ServerUnavailable: The program is ending, or its process was forked.
    """
    config = zenoh_config.client(
        endpoints,
        attempt_s,
        retry=_RETRY,
        max_message_bytes=wire.MAX_REPLY_BYTES,
        credentials=credentials,
    )
    limit_heaps()  # before the session's threads start
    opened: Future[zenoh.Session] = Future()
    with OPENING:  # in this thread: the error of a forked process needs no other
        threads.start("open session", _open, config, opened)
    try:
        return opened.result()
    except BaseException:
        opened.cancel()  # the caller was interrupted: nobody uses the session
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
