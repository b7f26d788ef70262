"""One limit that clients share: none of them can use up what the others need.

A client may hold as much as is left free when it has got it. So one greedy client gets half of
the limit, two get a third each, and there is always something left for the next one.

Thread safety: none; the owner locks.
"""

from __future__ import annotations

from zenoh_tf.errors import ServerBusy

from .limits import Limits


class FairShare:
    """What each client holds of the limit `name`."""

    def __init__(self, limits: Limits, name: str) -> None:
        self._limits = limits
        self._name = name
        self._limit: int = getattr(limits, name)
        self._held: dict[str, int] = {}
        self.total = 0

    def has_room(self, client: str, n: int) -> bool:
        """Whether the client can hold `n` more now."""
        free = self._limit - self.total - n
        held = self._held.get(client, 0) + n
        # The last one goes to a client that has none, so that a limit of 1 means 1.
        return free >= 0 and (held <= free or held <= 1)

    def check(self, client: str, n: int, retry_after_s: float) -> None:
        """Raise if the client cannot hold `n` more.

        Raises:
            LimitExceeded: It never can: `n` is above the limit.
            ServerBusy: It cannot hold them now.
        """
        if n > self._limit:
            raise self._limits.exceeded(self._name, n)
        if not self.has_room(client, n):
            held = self._held.get(client, 0) + n
            raise ServerBusy(
                f"{self._limits.describe(self._name, self.total + n)}; of these this client would "
                f"hold {held}, and only as many as are left free may be its own: try again in "
                f"{retry_after_s:.3g} s",
                field=self._name,
                limit=self._limit,
                value=self.total + n,
                retry_after_s=retry_after_s,
            )

    def take(self, client: str, n: int) -> None:
        """Add `n` to what the client holds; a negative `n` must leave it some. Does not check."""
        if n:
            self._held[client] = self._held.get(client, 0) + n
            self.total += n

    def give_back(self, client: str, n: int) -> None:
        """Subtract `n` from what the client holds."""
        if not n:
            return
        left = self._held[client] - n
        if left:
            self._held[client] = left
        else:
            del self._held[client]
        self.total -= n
