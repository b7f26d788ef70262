"""What `replies` and `outbox_links` need of the server."""

from __future__ import annotations

from typing import Protocol

from ..errors import TransformException


class ConnectedClients(Protocol):
    """Who is connected, by ids. All other clients together have the id ""."""

    #: The id in the queries of the server to itself.
    own: str

    def known(self, client: str) -> str:
        """The client's id if it is connected, else ""."""

    def has_been_known(self, client: str) -> bool:
        """True if the client is or was connected, though its link may still be there."""


class UnreadBytes(Protocol):
    """How many bytes of replies wait for each client, and why one may not have more."""

    #: Of all clients together. Changed under the lock of `Replies`, read without.
    total: int

    def held(self, client: str) -> int:
        """The bytes that wait for a client."""

    def try_take(self, client: str, n: int) -> bool:
        """Whether `n` bytes more may wait for a client. They do then."""

    def refusal(self, client: str, n: int, retry_after_s: float) -> TransformException:
        """Why `n` bytes more may not wait for a client."""

    def take_unchecked(self, client: str, n: int) -> None:
        """`n` bytes more wait for a client."""

    def give_back(self, client: str, n: int) -> None:
        """`n` bytes do not wait any more."""
