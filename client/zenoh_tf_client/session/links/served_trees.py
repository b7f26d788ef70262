"""Which trees a network serves, for the error of a client that does not find its own."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import zenoh

from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException

#: A message names at most this many trees.
_MAX_SHOWN: Final = 10


def served_trees(session: zenoh.Session, timeout_s: float) -> set[str]:
    """The trees whose servers declare themselves on the network; empty if nobody replies."""
    try:
        replies = session.liveliness().get(keys.all_servers(), timeout=timeout_s)
        tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok]
    except zenoh.ZError:  # the session was lost meanwhile
        return set()
    trees = set()
    for token in tokens:
        try:
            trees.add(keys.tree_name(token))
        except InvalidArgumentException:  # not a token of ours
            continue
    return trees


def no_server_message(tree: str, where: str, trees: Collection[str], timeout_s: float) -> str:
    """The error's text if no server of `tree` answered at endpoint `where`."""
    if tree in trees:
        return f"the server of tree {tree!r} at {where} did not answer within {timeout_s:g} s"
    if not trees:
        return (
            f"no server for tree {tree!r} at {where} within {timeout_s:g} s, nor for any other "
            "tree; start zenoh-tf-server"
        )
    shown = [repr(name) for name in sorted(trees)[:_MAX_SHOWN]]
    more = len(trees) - len(shown)
    if more:
        shown.append(f"and {more} more")
    return f"no server for tree {tree!r} at {where}; trees served there: {', '.join(shown)}"
