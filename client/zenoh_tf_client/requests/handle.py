"""`Handle`: the result of one operation of a batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from zenoh_tf.errors import TransformException

T = TypeVar("T")
A = TypeVar("A")


class Handle(Generic[T]):
    """The result of one recorded operation, once the batch has been sent."""

    __slots__ = ("_error", "_sent", "_value")

    def __init__(self) -> None:
        self._sent = False
        self._value: T | None = None
        self._error: TransformException | None = None

    def __repr__(self) -> str:
        if not self._sent:
            return "<Handle: not sent>"
        return f"<Handle: {self._value!r}>" if self._error is None else f"<Handle: {self._error!r}>"

    def result(self) -> T:
        """Return the operation's result.

        Returns:
            What the method of `TransformClient` returns.

        Raises:
            TransformException: The operation failed; the errors are that method's.
            RuntimeError: The batch has not been sent.
        """
        error = self.exception()
        if error is not None:
            raise error
        return self._value  # type: ignore[return-value]  # None only where T allows it

    def exception(self) -> TransformException | None:
        """Return the operation's error.

        Returns:
            The error that `result` raises; None if the operation succeeded.

        Raises:
            RuntimeError: The batch has not been sent.
        """
        if not self._sent:
            raise RuntimeError("the batch has not been sent: its `with` block has not ended")
        return self._error

    def _fail(self, error: TransformException) -> None:
        self._error = error
        self._sent = True

    def _settle(self, parse: Callable[[A], T], reply: A) -> None:
        """Keep what `parse` makes of the reply: a result, or the error that it raises."""
        try:
            self._value = parse(reply)
        except TransformException as error:
            self._error = error
        self._sent = True
