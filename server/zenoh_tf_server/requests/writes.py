"""Writes that run at most once, before their expiry, and only on the instance they are meant for.

Thread safety: all methods.
"""

from __future__ import annotations

from collections.abc import Callable

from zenoh_tf import wire
from zenoh_tf.errors import ServerRestarted
from zenoh_tf.text import quoted

from .handler import ReplyCallback
from .reply_cache import ReplyCache

#: Runs a write that expires at the given time of the server's clock. Returns the bytes of its reply
#: and what to remember of it: all or a part.
Run = Callable[[int], tuple[bytes, bytes]]
#: Makes the reply to a repeat from what is remembered.
Repeat = Callable[[bytes], bytes]


class Writes:
    """Decides which writes run; see the module."""

    def __init__(self, instance: str, cache: ReplyCache) -> None:
        self._instance = instance
        self._cache = cache

    def run(
        self,
        message: wire.Message,
        reply_to: ReplyCallback,
        error_reply: Callable[[Exception], bytes],
        what: str,
        run: Run,
        repeat: Repeat = lambda outcome: outcome,
        reserve: int = 0,
    ) -> None:
        """Run a write and reply, or reply with its outcome if this is a repeat.
        `error_reply` makes the reply of a write that fails. `what`: the kind of write.
        `reserve`: bytes that its outcome may have, where that is much.

        Raises:
            ServerRestarted: It is meant for another instance.
            TimeoutException: Its expiry has passed.
            LimitExceeded: Its expiry is too far ahead.
            InvalidArgumentException: Its id is that of a write of another kind.
            ServerBusy: Too much is remembered for its client.
        """
        write = wire.parse_write(message)
        if write.instance is not None and write.instance != self._instance:
            other = quoted(write.instance)
            raise ServerRestarted(
                f"the write is for server instance {other}, but this is instance "
                f"{self._instance}: it did not run; send it again to this one",
                value=other,
            )
        if write.id is None:
            reply_to(run(self._cache.expiry(write.expires_ns))[0], False)
            return

        def on_repeat(outcome: bytes, failed: bool) -> None:
            try:
                reply = outcome if failed else repeat(outcome)
            except Exception as error:  # of the reads in the repeat
                reply, failed = error_reply(error), True
            reply_to(reply, failed)

        expires_ns = self._cache.begin(
            write.id, reply_to.client, what, write.expires_ns, reserve, on_repeat
        )
        if expires_ns is None:
            return
        failed = False
        try:
            reply, outcome = run(expires_ns)
        except Exception as error:
            reply = outcome = error_reply(error)
            failed = True
        self._cache.finish(write.id, outcome, failed)
        reply_to(reply, failed)
