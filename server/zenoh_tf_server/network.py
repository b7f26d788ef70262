"""The Zenoh session of a server: a router of its own, or a client of a network."""

from __future__ import annotations

import json
from collections.abc import Sequence

import zenoh

from .limits import Limits

#: How long a server waits for the router that it joins, e.g. one starting beside it.
CONNECT_TIMEOUT_MS = 10_000
#: Messages up to this many times the limit are received, so that they can be refused
#: with a reply; larger ones Zenoh itself cuts off.
_RECEIVE_MARGIN = 4


class NetworkError(Exception):
    """The session cannot be opened; the message is one line for the user."""


def open_session(listen: Sequence[str], connect: Sequence[str], limits: Limits) -> zenoh.Session:
    """A session that listens on `listen` as a router, or joins `connect` as a client."""
    settings: dict[str, object] = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # nothing is scouted for
        # It can drop a reply when a receiver stalls for 100 ms.
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": _RECEIVE_MARGIN * limits.message_bytes,
    }
    if connect:
        settings |= {
            "mode": "client",
            "connect/endpoints": list(connect),
            "connect/timeout_ms": CONNECT_TIMEOUT_MS,
            "connect/retry": {
                "period_init_ms": 100,
                "period_max_ms": 1000,
                "period_increase_factor": 2,
            },
        }
    else:
        settings |= {
            "mode": "router",
            "listen/endpoints": list(listen),
            "listen/exit_on_failure": True,
            "transport/unicast/max_sessions": limits.connections,
        }
    config = zenoh.Config()
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise NetworkError(_explain(str(error), listen, connect)) from error


def _explain(reason: str, listen: Sequence[str], connect: Sequence[str]) -> str:
    """Zenoh's reason without the paths into its sources, in terms of the flags."""
    if connect:
        return f"cannot connect to {', '.join(connect)} within {CONNECT_TIMEOUT_MS / 1000:g} s"
    where = ", ".join(listen)
    if "Address already in use" in reason:
        return f"cannot listen on {where}: the port is already in use"
    return f"cannot listen on {where}: {reason.split(' at /', maxsplit=1)[0]}"
