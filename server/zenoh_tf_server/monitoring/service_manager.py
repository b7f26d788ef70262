"""Messages to systemd: ready, alive, stopping; see sd_notify(3).

A message is a datagram to the socket that ``NOTIFY_SOCKET`` names. Without it, nothing is sent.
"""

from __future__ import annotations

import logging
import os
import socket
from typing import Final

log = logging.getLogger("zenoh_tf.server")

_TIMEOUT_S: Final = 0.2


def notify(**fields: str | int) -> bool:
    """Send fields such as ``READY=1``. Returns False if there is no manager, or it cannot be
    reached."""
    path = os.environ.get("NOTIFY_SOCKET", "")
    if not path.startswith(("/", "@")):
        return False
    message = "\n".join(f"{name}={value}" for name, value in fields.items())
    if path.startswith("@"):  # a name without a file
        path = "\0" + path[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as manager:
            manager.settimeout(_TIMEOUT_S)
            manager.connect(path)
            manager.sendall(message.encode())
    except OSError as error:
        log.warning("cannot notify the service manager: %s", error)
        return False
    return True


def watchdog_s() -> float | None:
    """The time within which the manager wants ``WATCHDOG=1`` again and again; None: it does not."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    process = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not microseconds.isdigit() or int(microseconds) == 0 or process != str(os.getpid()):
        return None
    return int(microseconds) / 1e6
