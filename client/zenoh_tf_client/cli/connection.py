"""Opens the connection that every command uses."""

from __future__ import annotations

import argparse
from concurrent.futures import Future
from threading import Thread

from zenoh_tf_client import TransformClient


def connect(args: argparse.Namespace) -> TransformClient:
    """Return a client for the tree that the options name; a context manager.

    Raises what ``TransformClient.connect`` raises, and KeyboardInterrupt at once on Ctrl-C.
    """
    # Opening a Zenoh session blocks in native code, which Ctrl-C does not interrupt. Another
    # thread opens it, while this one waits in Python.
    opened: Future[TransformClient] = Future()

    def open_client() -> None:
        try:
            opened.set_result(
                TransformClient.connect(args.connect, tree=args.tree, timeout_s=args.timeout)
            )
        except BaseException as error:
            opened.set_exception(error)

    Thread(target=open_client, name="connect", daemon=True).start()
    return opened.result()
