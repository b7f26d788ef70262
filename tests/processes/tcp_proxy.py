"""A TCP proxy that delays, throttles, holds, cuts and resets the connections through it.

It runs in a thread of its own. Thread safety: all methods.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import threading
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing_extensions import Self

_CHUNK = 1 << 16
_CLOSE_TIMEOUT_S = 5.0
#: With this, closing a socket drops what is unsent and sends a reset.
_LINGER = struct.pack("ii", 1, 0)


class TcpProxy:
    """Forwards connections from `endpoint` to a target, both as ``tcp/HOST:PORT``."""

    def __init__(self, target: str) -> None:
        host, _, port = target.removeprefix("tcp/").rpartition(":")
        self._target = host, int(port)
        self._delay_s = 0.0
        self._bytes_per_s = 0.0
        self._connections: set[asyncio.StreamWriter] = set()
        self._accepted: list[socket.socket] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        self._flows = asyncio.Event()
        self._flows.set()
        self._thread = threading.Thread(target=self._loop.run_forever, name="proxy", daemon=True)
        self._thread.start()
        # Accepts by itself: asyncio leaves a connection open that it accepts while it is cancelled.
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._call(lambda: self._loop.add_reader(self._listener, self._accept))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def delay(self, seconds: float) -> None:
        """Forward everything this much later. A stream has one delay: it also limits the rate."""
        self._call(lambda: setattr(self, "_delay_s", seconds))

    def throttle(self, bytes_per_s: float) -> None:
        """Forward at most this many bytes a second each way; 0 for no limit."""
        self._call(lambda: setattr(self, "_bytes_per_s", bytes_per_s))

    def hold(self) -> None:
        """Forward nothing until `release`, as a partition that neither side notices."""
        self._call(self._flows.clear)

    def release(self) -> None:
        """Forward what was held, and continue."""
        self._call(self._flows.set)

    def cut(self) -> None:
        """Close all connections in an orderly way."""
        self._call(lambda: self._close_all(reset=False))

    def reset(self) -> None:
        """Reset all connections; what is under way is lost."""
        self._call(lambda: self._close_all(reset=True))

    def close(self) -> None:
        """Close everything and end the thread."""
        self._await(self._stop())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_CLOSE_TIMEOUT_S)
        self._loop.close()

    def _await(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(_CLOSE_TIMEOUT_S)

    def _call(self, action: Callable[[], object]) -> None:
        self._loop.call_soon_threadsafe(action)

    async def _stop(self) -> None:
        self._loop.remove_reader(self._listener)
        self._listener.close()
        while tasks := list(self._tasks):  # one that connects may have begun others
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        self._close_all(reset=True)
        await asyncio.sleep(0)  # transports close their sockets one turn later
        for peer in self._accepted:  # of tasks that were cancelled before they began
            peer.close()

    def _close_all(self, *, reset: bool) -> None:
        for writer in self._connections:
            if reset:
                with contextlib.suppress(OSError):
                    peer = writer.get_extra_info("socket")
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER)
                writer.transport.abort()
            else:
                writer.close()

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _accept(self) -> None:
        peer, _ = self._listener.accept()
        peer.setblocking(False)
        self._accepted = [one for one in self._accepted if one.fileno() >= 0] + [peer]
        self._begin(self._connect(peer))

    async def _connect(self, peer: socket.socket) -> None:
        reader, writer = await asyncio.open_connection(sock=peer)
        self._connections.add(writer)
        try:
            there_reader, there_writer = await asyncio.open_connection(*self._target)
        except OSError:  # as if nothing listened here
            self._connections.discard(writer)
            writer.transport.abort()
            return
        self._connections.add(there_writer)
        self._begin(self._pump(reader, there_writer))
        self._begin(self._pump(there_reader, writer))

    async def _pump(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        try:
            while data := await source.read(_CHUNK):
                if self._delay_s:
                    await asyncio.sleep(self._delay_s)
                if self._bytes_per_s:
                    await asyncio.sleep(len(data) / self._bytes_per_s)
                await self._flows.wait()
                sink.write(data)
                await sink.drain()
        except OSError:
            pass
        finally:
            self._connections.discard(sink)
            sink.close()
