"""Limits that clients share: who may hold how much, and what a refusal says.

1. All clients together hold the limit at most. What has no room is refused; what a client holds
   stays its own.
2. A client with a limit of its own holds that much at most. Else it may hold as much as is left
   free when it has got it: one greedy client gets half, two get a third each, and there is always
   something left for the next one. The last one goes to a client that has none.
3. A refusal is `ServerBusy` with the limit, what would be held of it, and when to try again. What
   never fits is `LimitExceeded`; but where clients have limits of their own, which is where
   something has arrived already, it is let in alone.

Two users can reclaim what they gave, so they refuse less. Frames of interests grow without being
asked for: `room`. Put queues have no time to refuse: a full one drops its oldest put, and the
longest one does if all are full together. They count for themselves, as a call for each put would
cost more than the queue.

Thread safety: none; the owner locks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from zenoh_tf.errors import ServerBusy, TransformException

from .limits import Limits


class FairShare:
    """What each client holds of the limit `name`."""

    def __init__(self, limits: Limits, name: str, own: str | int = 0) -> None:
        """`own`: the limit of each client or its name; 0 if there is none."""
        self._limits = limits
        self._name = name
        self._limit: int = getattr(limits, name)
        self._own_name = own if isinstance(own, str) else name
        self._own: int = getattr(limits, own) if isinstance(own, str) else own
        self._held: dict[str, int] = {}
        self.total = 0

    def held(self, client: str) -> int:
        """What the client holds."""
        return self._held.get(client, 0)

    def admit(self, client: str, n: int) -> bool:
        """Add `n` to what the client holds, if there is room. False: see `refusal`."""
        held, total = self._held.get(client, 0) + n, self.total + n
        if self._own:
            fits = (total <= self._limit or total == n) and (held <= self._own or held == n)
        else:
            free = self._limit - total
            fits = free >= 0 and (held <= free or held <= 1)
        if fits:
            self._held[client] = held
            self.total = total
        return fits

    def refusal(self, client: str, n: int, retry_after_s: float) -> TransformException:
        """Why the client is not given `n` more."""
        held, total = self.held(client) + n, self.total + n
        if self._own:
            why = "the request did not run"
            if n < total > self._limit:
                return busy(self._limits, self._name, total, why, retry_after_s)
            return busy(self._limits, self._own_name, held, why, retry_after_s)
        if n > self._limit:
            return self._limits.exceeded(self._name, n)
        why = f"this client would hold {held} of them, and as many must be left free"
        return busy(self._limits, self._name, total, why, retry_after_s)

    def check(self, client: str, n: int, retry_after_s: float) -> None:
        """Raise the refusal if there is no room for `n` more."""
        if not self.admit(client, n):
            raise self.refusal(client, n, retry_after_s)
        self.give_back(client, n)

    def take(self, client: str, n: int) -> None:
        """Add `n` to what the client holds; a negative `n` must leave it some. Does not check."""
        if n:
            self._held[client] = self._held.get(client, 0) + n
            self.total += n

    def give_back(self, client: str, n: int) -> None:
        """Subtract `n` from what the client holds."""
        left = self._held.pop(client, 0) - n
        if left:
            self._held[client] = left
        self.total -= n


def room(limit: int, free: int, held: Mapping[str, int], clients: Iterable[str]) -> int:
    """How much something may grow to that `clients` hold together: all that is free, or what is
    left of the share of one of them. Shares are equal, and one is left for the next client. So
    what others hold does not end what is small: what is above the share ends instead."""
    share = limit // (len(held) + 1)
    return max(free, *(share - held.get(client, 0) for client in clients), 0)


def busy(limits: Limits, name: str, value: int, why: str, retry_after_s: float) -> ServerBusy:
    """The refusal of what would make a limit's value `value`."""
    return ServerBusy(
        f"{limits.describe(name, value)}; {why}: try again in {retry_after_s:.3g} s",
        field=name,
        limit=getattr(limits, name),
        value=value,
        retry_after_s=retry_after_s,
    )
