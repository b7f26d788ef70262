"""The connection that every command opens, from the options they share."""

from __future__ import annotations

import argparse
from concurrent.futures import Future
from threading import Thread

from zenoh_tf_client import TransformClient


def connect(args: argparse.Namespace) -> TransformClient:
    """A client for the tree that the command names; a context manager.

    Raises what ``TransformClient.connect`` raises, and KeyboardInterrupt at once on Ctrl-C.
    """
    # Opening a Zenoh session blocks outside of Python, where Ctrl-C is not heard. So it happens
    # on another thread, while this one waits in a way that hears it.
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
