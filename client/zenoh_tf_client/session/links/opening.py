"""Opens the Zenoh session of a client, and finds out why if that fails.

No attempt is long, as none can be interrupted (`zenoh_tf._zenoh.opening`).
"""

from __future__ import annotations

import time
from typing import Final

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._zenoh import opening
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable, TransformException
from zenoh_tf.mirrors.free_memory import limit_heaps

#: The first attempt's time; the others take longer, for slow networks.
_FIRST_ATTEMPT_S: Final = 1.0
MAX_ATTEMPT_S: Final = 3.0
MIN_ATTEMPT_S: Final = 0.05
#: The same for each of several endpoints.
FIRST_OF_SEVERAL_S: Final = 0.25
#: Zenoh tries again this soon after a lost connection, then ever slower up to the maximum. It does
#: so within an attempt, too.
_RETRY: Final = {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2}
#: Zenoh's message after an attempt in which nobody answered; another attempt may succeed.
_NOBODY_THERE: Final = "Unable to connect"


def open_session(
    endpoint: str, tree: str, timeout_s: float, credentials: Credentials
) -> zenoh.Session:
    """Open a session at an endpoint, trying for `timeout_s`.

    Looks for the reason of a failure after the first attempt, so that a server that does not let
    this client in is not asked again, and once more at the end.

    Raises:
        ServerUnavailable: Nobody opened a session in time, the program is ending, or its process
            was forked.
        AccessDenied: The server does not let this client in, or cannot be trusted.
        InvalidArgumentException: The endpoint or `credentials` is invalid.
    """
    deadline_s = time.monotonic() + timeout_s
    attempt_s = _FIRST_ATTEMPT_S
    failure: TransformException | None = None
    while True:
        left_s = max(deadline_s - time.monotonic(), MIN_ATTEMPT_S)
        session = try_endpoint(endpoint, min(attempt_s, left_s), credentials)
        if session is not None:
            return session
        if not isinstance(failure, ServerUnavailable) or time.monotonic() >= deadline_s:
            previous = failure
            from zenoh_tf._zenoh import connect_failure  # noqa: PLC0415 - it loads ssl, which is slow

            failure = connect_failure.explain(endpoint, tree, timeout_s, credentials)
            if connect_failure.is_final(failure, previous) or time.monotonic() >= deadline_s:
                raise failure
        if isinstance(failure, ServerUnavailable):
            attempt_s = min(2 * attempt_s, MAX_ATTEMPT_S)


def try_endpoint(endpoint: str, attempt_s: float, credentials: Credentials) -> zenoh.Session | None:
    """Open a session in one attempt, on another thread. None: nobody opened one in time.

    Raises:
        InvalidArgumentException: The endpoint or `credentials` is invalid.
        ServerUnavailable: The program is ending, or its process was forked.
    """
    try:
        config = zenoh_config.client(
            [endpoint],
            attempt_s,
            retry=_RETRY,
            max_message_bytes=wire.MAX_REPLY_BYTES,
            credentials=credentials,
        )
        limit_heaps()  # before the session's threads start
        return opening.open_session(config)
    except zenoh.ZError as error:
        if _NOBODY_THERE in str(error):  # another attempt may succeed
            return None
        raise InvalidArgumentException(
            f"endpoint {zenoh_config.address(endpoint)!r}: "
            f"{str(error).split(' at /', maxsplit=1)[0]}",
            field="endpoint",
        ) from error
