"""What a query costs at least: a server's Zenoh session whose queryable answers at once.

Run by bench/remote.py as a process of its own: ``ENDPOINT REPLY_BYTES``. Built as the service
is: its session, a channel, a worker thread that receives, reads the payload and replies.
"""

from __future__ import annotations

import sys
import threading
from typing import Any

import zenoh

from zenoh_tf_server.limits import Limits
from zenoh_tf_server.network import open_session

KEY = "bench/empty"


def main() -> None:
    endpoint, reply_bytes = sys.argv[1], int(sys.argv[2])
    reply = bytes(reply_bytes)
    key = zenoh.KeyExpr(KEY)

    def work(handler: Any) -> None:
        try:
            while True:
                with handler.recv() as query:
                    query.payload.to_bytes()
                    query.reply(key, reply)
        except zenoh.ZError:
            return  # the session is closed

    with open_session([endpoint], [], Limits()) as session:
        queryable = session.declare_queryable(KEY, zenoh.handlers.FifoChannel(256), complete=True)
        threading.Thread(target=work, args=(queryable.handler,), daemon=True).start()
        print("ready", flush=True)
        sys.stdin.read()  # until the bench closes it, or is gone


if __name__ == "__main__":
    main()
