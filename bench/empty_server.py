"""A Zenoh session whose queryable answers at once: the least that a query can cost.

bench/reads.py runs it as a process: ``REPLY_BYTES ENDPOINT``. Built as the service is: its
session, a channel, and a worker that receives, reads the payload and replies.
"""

from __future__ import annotations

import sys

import zenoh

from zenoh_tf_server.limits import Limits
from zenoh_tf_server.process.network import open_session

KEY = "bench/empty"

if __name__ == "__main__":
    reply = bytes(int(sys.argv[1]))
    with open_session([sys.argv[2]], [], Limits()) as session:
        queryable = session.declare_queryable(KEY, zenoh.handlers.FifoChannel(256), complete=True)
        print("ready", flush=True)
        while True:  # until the benchmark ends it
            with queryable.handler.recv() as query:
                bytes(query.payload or b"")
                query.reply(zenoh.KeyExpr(KEY), reply)
