"""How requests and replies follow each other on a Unix socket, between processes of one host.

They are the messages that Zenoh would carry, each behind a header. A client sends its id, then a
request, and the next one after the reply. docs/reference/protocol.md describes it.

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

import struct
from typing import Final

#: Before each request: the length of its message, and its type, filled up with zero bytes.
REQUEST: Final = struct.Struct("<I8s")
#: Before each reply: the length of its message. 0: the client has to ask over Zenoh.
REPLY: Final = struct.Struct("<I")
#: In place of a type in the first request, which has no reply: its message is the client's id.
CLIENT: Final = b"client\0\0"
#: The requests that a server accepts. The others are rare, or do work for long.
REQUEST_TYPES: Final = {
    name.encode().ljust(8, b"\0"): name for name in ("lookup", "commit", "batch")
}
#: Longest request and reply. What is longer takes milliseconds to serve, so it may as well go over
#: Zenoh, where what waits is bounded in bytes.
MAX_REQUEST_BYTES: Final = 1 << 16
MAX_REPLY_BYTES: Final = 1 << 20
