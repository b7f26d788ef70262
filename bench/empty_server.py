"""What a query costs at least: a router whose queryable answers at once with 100 bytes.

Run by bench/remote.py as a process of its own, built as the service is: a worker thread behind a
FIFO answers.
"""

from __future__ import annotations

import json
import sys
import threading
from typing import Any

import zenoh

KEY = "bench/empty"


def configuration(mode: str, endpoint: str) -> zenoh.Config:
    """A session that scouts for nobody and shares no memory."""
    config = zenoh.Config()
    where = "listen" if mode == "router" else "connect"
    settings = {
        "mode": mode,
        f"{where}/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def main() -> None:
    reply = bytes(100)

    def work(handler: Any) -> None:
        try:
            while True:
                with handler.recv() as query:
                    query.reply(KEY, reply)
        except zenoh.ZError:
            return  # the session is closed

    with zenoh.open(configuration("router", sys.argv[1])) as session:
        queryable = session.declare_queryable(KEY, zenoh.handlers.FifoChannel(1024), complete=True)
        threading.Thread(target=work, args=(queryable.handler,), daemon=True).start()
        print("ready", flush=True)
        sys.stdin.read()  # until the bench closes it, or is gone


if __name__ == "__main__":
    main()
