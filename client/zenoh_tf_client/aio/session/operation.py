"""A call of the asynchronous client that waits for its result."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ...requests.request import Request

if TYPE_CHECKING:
    from .message import Message

T = TypeVar("T")


class Operation(Generic[T]):
    """A request, and the future that its caller awaits."""

    __slots__ = ("future", "message", "request")

    def __init__(self, request: Request[T], future: asyncio.Future[T]) -> None:
        self.request = request
        self.future = future
        self.message: Message | None = None  # once it is under way

    def succeed(self, result: T) -> None:
        """Give the caller the result."""
        if not self.future.done():
            self.future.set_result(result)

    def settle(self, result: Callable[[], T]) -> None:
        """Give the caller the result, or the error that `result` raises."""
        if self.future.done():  # cancelled
            return
        try:
            self.future.set_result(result())
        except Exception as error:
            self.future.set_exception(error)

    def fail(self, error: Exception) -> None:
        """Give the caller an error."""
        if not self.future.done():
            self.future.set_exception(error)


AnyOperation = Operation[Any]
