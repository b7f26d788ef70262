"""Errors as maps ``{"code", "message", "facts"}`` and back, nothing lost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import BY_CODE, FACTS, InvalidArgumentException, TransformException
from .fields import Message, integer, mapping, text, wrong

_FACT_TYPES = (str, int, float, type(None))


def fault(error: TransformException) -> Message:
    """The map of an error."""
    return {"code": error.code, "message": str(error), "facts": error.facts}


def parse_fault(message: Any, field: str = "error") -> TransformException:
    """The error behind a map. A code that this side does not know becomes the base class,
    facts that it does not know are left out: a newer server must stay understandable."""
    if type(message) is not dict:
        raise wrong(field, "a map")
    kind = BY_CODE.get(integer(message, "code"), TransformException)
    facts = {name: value for name, value in mapping(message, "facts").items() if name in FACTS}
    if not all(type(value) in _FACT_TYPES for value in facts.values()):
        raise wrong("facts", "texts, numbers and nil")
    return kind(text(message, "message"), **facts)


def error_reply(instance: str, error: TransformException) -> Message:
    """The answer to a request that failed as a whole."""
    return {"v": 1, "instance": instance, "error": fault(error)}


def raise_error(reply: Mapping[str, Any]) -> None:
    """Raise the error of a reply, if it is one."""
    error = reply.get("error")
    if error is not None:
        raise parse_fault(error)


def as_transform_exception(error: Exception) -> TransformException:
    """Any failure as one that can travel; the tree's own pass through."""
    if isinstance(error, TransformException):
        return error
    if isinstance(error, (TypeError, ValueError, OverflowError)):
        return InvalidArgumentException(str(error))
    return TransformException(f"internal error: {type(error).__name__}: {error}")
