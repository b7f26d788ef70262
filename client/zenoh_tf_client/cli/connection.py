"""Opens the connection that every command uses."""

from __future__ import annotations

import argparse

from zenoh_tf_client import TransformClient


def connect(args: argparse.Namespace) -> TransformClient:
    """Return a client for the tree that the options name; a context manager.

    Raises what ``TransformClient.connect`` raises.
    """
    return TransformClient.connect(args.connect, tree=args.tree, timeout_s=args.timeout)
