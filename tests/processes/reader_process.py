"""A client in a process of its own, which reads no replies while it is stopped.

``python reader_process.py ENDPOINT ROWS COUNT``: says "ready", and on each line of its input sends
COUNT lookups of ROWS rows without waiting for the replies. After the line "ask and freeze" it stops
itself (SIGSTOP). On the line "count" it says how many were answered, and how many refused as busy.
"""

from __future__ import annotations

import os
import signal
import sys
import threading

import numpy as np
import zenoh

from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import ServerBusy

TIMEOUT_S = 60.0
_ONCE = zenoh.ConsolidationMode.NONE


class Reader:
    def __init__(self, endpoint: str, rows: int) -> None:
        self.session = zenoh.open(zenoh_config.client([endpoint], 5.0, max_message_bytes=1 << 28))
        client = str(self.session.zid())
        self._token = self.session.liveliness().declare_token(keys.client("main", client))
        self._attachment = f"{client} {keys.TAKES_PARTS}".encode()
        zeros = np.zeros(rows, "<u4")
        self._payload = wire.pack(
            {
                "v": 1,
                "names": ["map", "base"],
                "op": np.full(rows, wire.OP_LATEST, "u1").tobytes(),
                "target": zeros.tobytes(),
                "source": (zeros + 1).tobytes(),
                "stamp": zeros.astype("<i8").tobytes(),
            }
        )
        self._lock = threading.Lock()
        self.answered = 0
        self.refused = 0

    def ask(self) -> threading.Event:
        """Send one lookup; the event is set when it has ended."""
        ended = threading.Event()
        length = 0

        def on_reply(reply: zenoh.Reply) -> None:
            nonlocal length
            if reply.ok is None:
                assert reply.err is not None
                error = wire.decode_error(wire.unpack(reply.err.payload.to_bytes())["error"])
                assert isinstance(error, ServerBusy), error
                with self._lock:
                    self.refused += 1
                return
            length += len(reply.ok.payload)
            attachment = reply.ok.attachment
            if attachment is None or length == int(attachment.to_bytes()):
                with self._lock:
                    self.answered += 1

        self.session.get(
            keys.request("main", "lookup"),
            zenoh.handlers.Callback(on_reply, ended.set, indirect=False),
            payload=self._payload,
            attachment=self._attachment,
            timeout=TIMEOUT_S,
            consolidation=_ONCE,
        )
        return ended


def main() -> None:
    endpoint, rows, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    reader = Reader(endpoint, rows)
    asked: list[threading.Event] = []
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() == "count":
            for ended in asked:
                ended.wait(TIMEOUT_S)
            print(reader.answered, reader.refused, flush=True)
        else:
            asked += [reader.ask() for _ in range(count)]
            print("sent", flush=True)
            if line.strip() == "ask and freeze":
                os.kill(os.getpid(), signal.SIGSTOP)


if __name__ == "__main__":
    main()
