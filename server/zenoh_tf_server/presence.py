"""One server per tree: the liveliness token, and who yields.

Two servers on one tree would answer each other's clients from different data. Each looks
for others, declares its token, and looks again. Of two that start at once:

- tokens and looks pass the network in order, so at least one of the two sees the other;
- the one with the higher instance id yields as soon as it sees the other;
- the one with the lower id waits for the other to yield; if it stays, it did not see us
  and serves already, so we yield.
"""

from __future__ import annotations

import time

import zenoh

from zenoh_tf import keys

_LOOK_TIMEOUT_S = 2.0
_YIELD_TIMEOUT_S = 1.5
_LOOK_PERIOD_S = 0.1


class TreeTaken(Exception):
    """Another server serves the tree."""

    def __init__(self, tree: str, other: str) -> None:
        super().__init__(
            f"tree {tree!r} is already served on this network by server instance {other}"
        )
        self.tree = tree
        self.other = other


def refuse_if_taken(session: zenoh.Session, tree: str) -> None:
    """Raise TreeTaken if a server of the tree is there, before anything is declared."""
    for other in _others(session, tree, ""):
        raise TreeTaken(tree, other)


def claim(session: zenoh.Session, tree: str, instance: str) -> zenoh.LivelinessToken:
    """Declare this server's token, or raise TreeTaken. Call it when everything is served:
    clients take the token as the sign that puts and queries arrive."""
    token = session.liveliness().declare_token(keys.server(tree, instance))
    deadline_s = time.monotonic() + _YIELD_TIMEOUT_S
    while others := _others(session, tree, instance):
        if min(others) < instance or time.monotonic() > deadline_s:
            token.undeclare()
            raise TreeTaken(tree, min(others))
        time.sleep(_LOOK_PERIOD_S)
    return token


def _others(session: zenoh.Session, tree: str, instance: str) -> set[str]:
    replies = session.liveliness().get(keys.servers(tree), timeout=_LOOK_TIMEOUT_S)
    found = {keys.last_name(str(reply.ok.key_expr)) for reply in replies if reply.ok}
    return found - {instance}
