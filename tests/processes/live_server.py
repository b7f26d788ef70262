"""A server in the process of its tests: it starts quickly, and its fixed limits may be others."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from zenoh_tf_client import TransformClient
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.process.sharing import SharingSettings
from zenoh_tf_server.server import Server
from zenoh_tf_server.settings import Concurrency, ServerSettings

from .ports import free_endpoint
from .servers import count_start


class LiveServer:
    """The service as ``zenoh-tf-server`` runs it, with a router of its own on a loopback port.

    It runs in this process, so that each test can start one quickly. Its clients still reach it
    through Zenoh over TCP.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        concurrency: Concurrency,
        sharing: SharingSettings,
        **settings: Any,
    ) -> None:
        self.endpoint = free_endpoint()
        defaults: dict[str, Any] = {
            "tree": "main",
            "listen": [self.endpoint],
            "connect": [],
            "cache_time_s": 10.0,
            "concurrency": concurrency,
            "one_authority_per_frame": False,
            "time_jump": "reject",
            "workers": 2,
            "limits": Limits(),
            "sharing": sharing,
        }
        self.settings = ServerSettings(**defaults | settings)
        self._loop = loop
        self._server: Server | None = None
        self.start()

    def start(self) -> None:
        """Start with an empty tree, after `stop` at the same endpoint again."""
        assert self._server is None
        self._server = Server(self.settings, self._loop)
        count_start()

    def stop(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def connect(self) -> TransformClient:
        """Return another client. The caller closes it."""
        tf = TransformClient.connect(self.endpoint)
        assert tf.reads == ("shared" if not self.settings.sharing.off else "query")
        return tf


@contextmanager
def running_loop() -> Iterator[asyncio.AbstractEventLoop]:
    """The event loop of such servers, on a thread of its own."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    yield loop
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


@contextmanager
def limited(**limits: int) -> Iterator[LiveServer]:
    """A server with other limits, also those that no flag sets."""
    with running_loop() as loop:
        server = LiveServer(loop, "optimistic", SharingSettings(off=True), limits=Limits(**limits))
        try:
            yield server
        finally:
            server.stop()
