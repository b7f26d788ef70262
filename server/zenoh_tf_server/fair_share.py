"""Limits that clients share: how much of one each client may hold, and the error for a refusal.

1. All clients together hold at most the limit. `try_take` refuses what would exceed it, and never
   takes away what a client holds.
2. With a limit per client, a client holds at most that. Without one, a client may grow as long as
   at least as much is left free: with n heavy clients each gets 1/(n+1), so a new client always
   finds capacity. A client that holds nothing may also take the last unit.
3. A refusal is `ServerBusy` with the limit, the value that it would reach, and when to try again.
   What could never fit is `LimitExceeded`. With limits per client, which count what has already
   arrived, a request that alone exceeds a limit is admitted if nothing else counts against it.

Three limits are shared elsewhere. In two of them something can be reclaimed in place of a refusal.
The frames of interests use `room`: they grow on their own, and the interest above its share ends.
Put queues (`ingest/put_queues.py`) drop their oldest put, and count for themselves, as a call of
this class for each put would cost more than the queue. Of a site's frames each robot has a
share of its own, which counts names (`federation/quota.py`).

Thread safety: none; the owner locks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from zenoh_tf.errors import ServerBusy, TransformException

from .limits import Limits


class FairShare:
    """What each client holds of the limit `name`."""

    def __init__(self, limits: Limits, name: str, own_name: str = "") -> None:
        """`own_name`: that of the limit of each client, if there is one."""
        self._limits = limits
        self._name = name
        self._limit: int = getattr(limits, name)
        self._own_name = own_name
        self._own: int = getattr(limits, own_name) if own_name else 0
        self._held: dict[str, int] = {}
        self.total = 0

    def held(self, client: str) -> int:
        """What the client holds."""
        return self._held.get(client, 0)

    def try_take(self, client: str, n: int) -> bool:
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
            if n < total and total > self._limit:
                return busy(self._limits, self._name, total, why, retry_after_s)
            return busy(self._limits, self._own_name, held, why, retry_after_s)
        if n > self._limit:
            return self._limits.exceeded(self._name, n)
        why = f"this client would hold {held} of them, and as many must be left free"
        return busy(self._limits, self._name, total, why, retry_after_s)

    def require_room(self, client: str, n: int, retry_after_s: float) -> None:
        """Raise the refusal if there is no room for `n` more; takes nothing."""
        if not self.try_take(client, n):
            raise self.refusal(client, n, retry_after_s)
        self.give_back(client, n)

    def take_unchecked(self, client: str, n: int) -> None:
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
