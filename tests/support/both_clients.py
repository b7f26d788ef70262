"""Runs a module's tests over both clients: over the asynchronous one through a blocking shell.

A test module uses the fixture: ``pytestmark = pytest.mark.usefixtures("either_client")``.
"""

from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from zenoh_tf_client import AsyncBatch, AsyncTransaction, AsyncTransformClient

if TYPE_CHECKING:
    from typing_extensions import Self

#: Far above what any test waits for.
TIMEOUT_S = 50.0


class LoopThread:
    """An event loop that runs on a thread of its own."""

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self.loop.run_forever, name="loop")
        self._thread.start()

    def run(self, awaitable: Any) -> Any:
        async def wait() -> Any:
            return await awaitable

        return asyncio.run_coroutine_threadsafe(wait(), self.loop).result(TIMEOUT_S)

    def stop(self) -> None:
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join()
        self.loop.run_until_complete(self.loop.shutdown_default_executor())
        self.loop.close()


class Blocking:
    """An object of the asynchronous client, used as its synchronous counterpart is."""

    def __init__(self, target: Any, thread: LoopThread) -> None:
        self._target = target
        self._thread = thread

    @classmethod
    def connect(cls, thread: LoopThread, *arguments: Any, **more: Any) -> Self:
        return cls(thread.run(AsyncTransformClient.connect(*arguments, **more)), thread)

    def __repr__(self) -> str:
        return repr(self._target).replace("<Async", "<")

    def __enter__(self) -> Self:
        self._thread.run(self._target.__aenter__())
        return self

    def __exit__(self, *error: object) -> None:
        self._thread.run(self._target.__aexit__(*error))

    def __getattr__(self, name: str) -> Any:
        return self._shown(getattr(self._target, name))

    def run_transaction(self, function: Callable[[Any], Any], *arguments: Any, **more: Any) -> Any:
        async def asynchronous(tx: AsyncTransaction) -> Any:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(None, function, Blocking(tx, self._thread))

        return self._shown(self._target.run_transaction(asynchronous, *arguments, **more))

    def _shown(self, value: Any) -> Any:
        if inspect.isawaitable(value):
            value = self._thread.run(value)
        if isinstance(value, AsyncBatch | AsyncTransaction):
            return Blocking(value, self._thread)
        if inspect.ismethod(value):
            return lambda *arguments, **more: self._shown(value(*arguments, **more))
        return value
