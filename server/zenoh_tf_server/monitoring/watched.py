"""What monitoring sees of a running server, or of a replica."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import zenoh

from ..requests.handler import Handler
from ..transport.clients import Clients


class Watched(Protocol):
    """A server that serves."""

    @property
    def session(self) -> zenoh.Session:
        """Its Zenoh session, on which clients ask."""

    @property
    def clients(self) -> Clients:
        """The clients that are connected."""

    @property
    def key(self) -> Callable[[str], str]:
        """The key of a request type."""

    @property
    def service(self) -> Handler:
        """What serves its requests."""

    @property
    def instance(self) -> str:
        """Its instance id."""

    @property
    def age_s(self) -> float | None:
        """Of a replica: how old what is served may be, in seconds."""
