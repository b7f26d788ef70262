"""The newest commit that one client has seen, so that its reads never go back.

A client with several endpoints may come to a server whose state is older than what it has read or
written elsewhere. So each of its requests says what it has seen, and a server that lacks that
answers `ServerBusy`.

Thread safety: all methods; `value` may be read at any time.
"""

from __future__ import annotations

import threading

from zenoh_tf import wire

from ..requests.receipt import Receipt

_NOTHING = Receipt("", 0)


class Floor:
    """What the client's next request must see."""

    def __init__(self) -> None:
        self.value = _NOTHING
        self._lock = threading.Lock()

    def add(self, body: wire.Message) -> wire.Message:
        """The body of a request that must see it; one that names a commit itself stays."""
        return body if wire.FLOOR in body else wire.floor_field(*self.value) | body

    def record(self, reply: wire.Message, before: Receipt | None) -> None:
        """Accept what a reply has seen. `before`: `value` when it was asked for; None: the request
        named another commit. A lower number than it named is right: that one was forged."""
        seq = reply.get("seq")
        if type(seq) is not int:
            return
        seen = Receipt(wire.text(reply, "instance"), seq)
        with self._lock:
            now = self.value
            is_later = seen.instance == now.instance and seen.seq > now.seq
            if is_later or before is now or now is _NOTHING:
                self.value = seen
