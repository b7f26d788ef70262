"""One server per tree: a server claims its tree with a liveliness token.

Two servers of one tree would reply to each other's clients from different data. Each server looks
for other tokens, declares its own, and looks again. If two servers start at once:

- Tokens and queries pass the network in order, so at least one of the two sees the other.
- The server with the higher instance id yields as soon as it sees the other.
- The server with the lower id waits for the other to yield. If the other stays, it has not seen
  this one and is already serving, so this one yields.

A network that does not answer in time says nothing: it is asked again, and in the end the server
does not start.
"""

from __future__ import annotations

import time
from typing import Final

import zenoh

from zenoh_tf import keys
from zenoh_tf.text import quoted

from .network import NetworkError

_QUERY_TIMEOUT_S: Final = 2.0
#: A network that has not answered for so long is taken for broken.
_SILENT_S: Final = 10.0
_YIELD_TIMEOUT_S: Final = 1.5
_POLL_PERIOD_S: Final = 0.1


class TreeTaken(Exception):
    """Another server serves the tree."""

    def __init__(self, tree: str, other: str) -> None:
        super().__init__(
            f"tree {tree!r} is already served on this network by server instance {other}; "
            "stop that server, or choose another tree with --tree"
        )
        self.tree = tree
        self.other = other


def refuse_if_taken(session: zenoh.Session, tree: str) -> None:
    """Check for other servers of the tree. Call it before anything is declared.

    Raises:
        TreeTaken: Another server has a token.
        NetworkError: The network does not say whether one has.
    """
    for other in _other_instances(session, tree, ""):
        raise TreeTaken(tree, other)


def claim(session: zenoh.Session, tree: str, instance: str) -> zenoh.LivelinessToken:
    """Declare this server's token. Call it when everything is served: clients take the token as
    the sign that puts and queries arrive.

    Raises:
        TreeTaken: Another server claimed the tree at the same time, and this one yields.
        NetworkError: The network does not say whether one did.
    """
    token = session.liveliness().declare_token(keys.server(tree, instance))
    deadline_s = time.monotonic() + _YIELD_TIMEOUT_S
    while others := _other_instances(session, tree, instance):
        if min(others) < instance or time.monotonic() > deadline_s:
            token.undeclare()
            raise TreeTaken(tree, min(others))
        time.sleep(_POLL_PERIOD_S)
    return token


def _other_instances(session: zenoh.Session, tree: str, instance: str) -> set[str]:
    """The instances that have a token of the tree, without this one.

    Raises:
        NetworkError: The network does not say.
    """
    deadline_s = time.monotonic() + _SILENT_S
    while True:
        replies = list(session.liveliness().get(keys.servers(tree), timeout=_QUERY_TIMEOUT_S))
        tokens = [reply.ok for reply in replies if reply.ok]
        others = {keys.last_name(str(token.key_expr)) for token in tokens} - {instance}
        if others or len(tokens) == len(replies):  # else one reply says that time was up
            return others
        if time.monotonic() > deadline_s:
            raise NetworkError(
                f"the network did not say within {_SILENT_S:g} s whether another server has tree "
                f"{quoted(tree)}; try again when it answers"
            )
