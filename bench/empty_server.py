"""A Zenoh session whose queryable answers at once: the least that a query can cost.

bench/remote.py runs it as a process: ``ENDPOINT REPLY_BYTES``. Built as the service is: its
session, a channel, a worker thread that receives, reads the payload and replies.
"""

from __future__ import annotations

import contextlib
import sys
import threading
from typing import Any

import zenoh

from zenoh_tf_server.limits import Limits
from zenoh_tf_server.network import open_session

KEY = "bench/empty"


def work(handler: Any, reply: bytes) -> None:
    with contextlib.suppress(zenoh.ZError):  # the session is closed
        while True:
            with handler.recv() as query:
                query.payload.to_bytes()
                query.reply(zenoh.KeyExpr(KEY), reply)


if __name__ == "__main__":
    with open_session([sys.argv[1]], [], Limits()) as session:
        queryable = session.declare_queryable(KEY, zenoh.handlers.FifoChannel(256), complete=True)
        arguments = (queryable.handler, bytes(int(sys.argv[2])))
        threading.Thread(target=work, args=arguments, daemon=True).start()
        print("ready", flush=True)
        sys.stdin.read()  # until the benchmark closes it or ends
