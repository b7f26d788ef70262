"""The `admin` requests: `clear`, `reset` and `remove_frame`."""

from __future__ import annotations

import logging

from zenoh_tf import wire
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.text import quoted

from ..ingest.refusals import Refusals
from ..limits import Limits
from ..rate_limited_log import RateLimitedLog
from ..state.static_links import StaticLinks


class AdminRequests:
    """Runs `admin` requests, and logs them. Thread safety: all methods."""

    def __init__(self, links: StaticLinks, limits: Limits, refusals: Refusals) -> None:
        self._links = links
        self._refusals = refusals
        self._name_bytes = limits.name_bytes
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server"))

    def run(self, message: wire.Message, expires_ns: int) -> wire.Message:
        """Run a request and return the fields of the reply, once the change is durable.

        Args:
            message: The request.
            expires_ns: Time of the monotonic clock after which it must not run.

        Raises:
            TransformException: It did not run.
            NotDurable: It did, but its change is not stored yet.
        """
        what = wire.text(message, "what")
        if what == "clear":
            state_write = self._links.clear(wire.flag(message, "keep_static", True), expires_ns)
            self._log.info("clear", "cleared the tree")
        elif what == "reset":
            state_write = self._links.reset(expires_ns)
            self._refusals.forget_reasons()
            self._log.info("reset", "reset the tree: every frame is gone")
        elif what == "remove_frame":
            name = wire.name(message, "name", self._name_bytes)
            state_write = self._links.remove_frame(name, wire.flag(message, "subtree"), expires_ns)
            self._log.info("remove_frame", f"removed frame {quoted(name)}")
        else:
            raise InvalidArgumentException(f"unknown admin request {quoted(what)}", field="what")
        self._links.wait(state_write)
        return {"value": None}
