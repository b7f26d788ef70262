"""One server per tree: a server claims its tree with liveliness tokens.

Two servers of one tree would reply to each other's clients from different data. Each server first
declares a candidate's token, then queries other candidates and servers:

- Tokens and queries pass the network in order, so of two candidates at least one sees the other.
- A candidate yields to a server, and to a candidate with a lower instance id.
- The candidate with the lowest id waits until each other one that it sees has yielded or, because
  it has not seen this one, serves. However slow they are, one of them serves in the end.
- A candidate without a rival has the tree. When it serves, it declares a server's
  token, and then withdraws its candidate's. Candidates are queried before servers, so it is never
  missed.

A network that does not answer in time says nothing: it is asked again, and in the end the server
does not start.
"""

from __future__ import annotations

import time
from typing import Final

import zenoh

from zenoh_tf._net import keys
from zenoh_tf.text import quoted

from .network import NetworkError

_QUERY_TIMEOUT_S: Final = 2.0
#: A network that has not answered for so long counts as broken.
_SILENT_S: Final = 10.0
#: Longer than a session without keep-alive messages keeps its tokens.
_YIELD_TIMEOUT_S: Final = 20.0
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


class Claim:
    """A claim of a tree, from construction to `close`. Claim it before anything is declared: a
    network never has two servers' queryables, of which it could keep a route to the wrong one.

    Raises:
        TreeTaken: Another server has the tree, or claimed it at the same time and this one yields.
        NetworkError: The network does not say whether one has or did.
    """

    def __init__(self, session: zenoh.Session, tree: str, instance: str) -> None:
        self._session = session
        self._key = keys.server(tree, instance)
        self._candidate: zenoh.LivelinessToken | None = None
        self._server: zenoh.LivelinessToken | None = None
        _refuse_if_taken(session, tree)  # without a candidate, for which others would wait
        self._candidate = session.liveliness().declare_token(keys.candidate(tree, instance))
        try:
            deadline_s = time.monotonic() + _YIELD_TIMEOUT_S
            while others := _others(session, tree, instance, keys.candidates(tree)):
                _refuse_if_taken(session, tree)
                if min(others) < instance or time.monotonic() > deadline_s:
                    raise TreeTaken(tree, min(others))
                time.sleep(_POLL_PERIOD_S)
            _refuse_if_taken(session, tree)
        except BaseException:
            self.close()
            raise

    def serve(self) -> None:
        """Declare the server's token. Call it when everything is served: to clients the token
        means that puts and queries arrive."""
        self._server = self._session.liveliness().declare_token(self._key)
        self._withdraw()

    def close(self) -> None:
        if self._server is not None:
            self._server.undeclare()
            self._server = None
        self._withdraw()

    def _withdraw(self) -> None:
        if self._candidate is not None:
            self._candidate.undeclare()
            self._candidate = None


def _refuse_if_taken(session: zenoh.Session, tree: str) -> None:
    """Check for other servers of the tree.

    Raises:
        TreeTaken: Another server has a token.
        NetworkError: The network does not say whether one has.
    """
    for other in _others(session, tree, "", keys.servers(tree)):
        raise TreeTaken(tree, other)


def _others(session: zenoh.Session, tree: str, instance: str, key_expr: str) -> set[str]:
    """The instances that have a token of the key expression, without this one.

    Raises:
        NetworkError: The network does not say.
    """
    deadline_s = time.monotonic() + _SILENT_S
    while True:
        replies = list(session.liveliness().get(key_expr, timeout=_QUERY_TIMEOUT_S))
        tokens = [reply.ok for reply in replies if reply.ok]
        others = {keys.last_name(str(token.key_expr)) for token in tokens} - {instance}
        if others or len(tokens) == len(replies):  # else one reply says that time was up
            return others
        if time.monotonic() > deadline_s:
            raise NetworkError(
                f"the network did not say within {_SILENT_S:g} s whether another server has tree "
                f"{quoted(tree)}; try again when it answers"
            )
