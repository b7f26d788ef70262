"""Whether the server is ready, and whether it works: a probe lookup through the real workers.

A process that lives may still serve nobody. So a thread looks a frame up every few seconds, by a
query on the server's own key, and any reply of this instance counts: also a refusal shows that
workers run. A restart would not make a busy server less busy.

Thread safety: all methods.
"""

from __future__ import annotations

import functools
import logging
import time
from collections.abc import Callable
from typing import Final

import zenoh

from zenoh_tf import wire
from zenoh_tf.errors import TransformException
from zenoh_tf.threads import Periodic

from ..transport.running_server import RunningServer

#: The server counts as healthy for this long after a probe began that was answered.
HEALTHY_FOR_S: Final = 10.0
#: Between two probes.
PERIOD_S: Final = 2.0
#: How long a probe waits for its reply.
_TIMEOUT_S: Final = 5.0
#: Any name will do; the tree need not have such a frame.
_FRAME: Final = "zenoh-tf-health"
_REQUEST: Final = wire.pack_one_read(_FRAME, _FRAME, wire.OP_COMMON, wire.NO_STAMP)

log = logging.getLogger("zenoh_tf.server.health")


class Health:
    """Probes a server from `serving` to `stopping`."""

    def __init__(self, period_s: float = PERIOD_S, timeout_s: float = _TIMEOUT_S) -> None:
        """A probe every `period_s` or more rarely; each waits `timeout_s` for its reply."""
        #: Called after each probe that was answered.
        self.answered: Callable[[], object] = lambda: None
        self._period_s = period_s
        self._timeout_s = timeout_s
        self._probes: Periodic | None = None
        self._healthy_until_s = 0.0
        self.ready = False
        self.probe_duration_s = 0.0

    @property
    def healthy(self) -> bool:
        """True if a worker has answered a probe that began within the last HEALTHY_FOR_S."""
        return time.monotonic() < self._healthy_until_s

    def serving(self, server: RunningServer) -> None:
        """The tree of `server` is claimed and served: begin to probe."""
        self._healthy_until_s = time.monotonic() + HEALTHY_FOR_S
        self.ready = True
        probe = functools.partial(self._probe, server)
        self._probes = Periodic("health", probe, self._period_s)
        self._probes.start()

    def stopping(self) -> None:
        """The server closes now: it is no longer ready, and not probed any more."""
        self.ready = False
        if self._probes is not None:
            self._probes.close()

    def _probe(self, server: RunningServer) -> None:
        begun_s = time.monotonic()
        problem = probe(
            server.session,
            server.key("lookup"),
            server.service.instance,
            server.clients.own,
            self._timeout_s,
        )
        if not self.ready:  # stopping
            return
        if problem is None:
            self.probe_duration_s = time.monotonic() - begun_s
            self._healthy_until_s = begun_s + HEALTHY_FOR_S
            self.answered()
        else:
            log.warning("the probe lookup failed: %s", problem)


def probe(
    session: zenoh.Session, key: str, instance: str, client: str, timeout_s: float
) -> str | None:
    """Look a frame up by a query that stays in this process. Returns what is wrong, or None.

    With the `client` id of the server itself, the reply waits for no link, and the query is not
    counted among those of other clients.
    """
    try:
        replies = session.get(
            key,
            payload=_REQUEST,
            attachment=client.encode(),
            timeout=timeout_s,
            consolidation=zenoh.ConsolidationMode.NONE,
            allowed_destination=zenoh.Locality.SESSION_LOCAL,
        )
        for reply in replies:
            sample = reply.ok or reply.err
            if sample is None:
                continue
            if wire.unpack(sample.payload.to_bytes()).get("instance") == instance:
                return None
            return "the reply is not of this server"
    except (zenoh.ZError, TransformException) as error:
        return str(error)
    return f"no reply within {timeout_s:g} s"
