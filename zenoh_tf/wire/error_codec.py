"""Errors as maps ``{"code", "message", "facts"}`` and back, without loss."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import BY_CODE, FACTS, InvalidArgumentException, TransformException
from .fields import Message, integer, malformed, mapping, text

_FACT_TYPES = (str, int, float, type(None))
#: Characters of an error's message and of each fact; names have less.
_MAX_MESSAGE = 4000
_MAX_FACT = 1000


def encode_error(error: TransformException) -> Message:
    """The map that carries an error. Texts that are far too long are cut off."""
    message = str(error)
    facts = error.facts
    if len(message) > _MAX_MESSAGE:
        message = message[:_MAX_MESSAGE] + "..."
        for name, value in facts.items():
            if isinstance(value, str) and len(value) > _MAX_FACT:
                facts[name] = value[:_MAX_FACT] + "..."
    return {"code": error.code, "message": message, "facts": facts}


def decode_error(message: Any, field: str = "error") -> TransformException:
    """The error that a map carries. Errors of a newer server stay understandable: an unknown code
    becomes the base class, and unknown facts are left out.

    Raises:
        ProtocolError: The map is malformed; `field` names the field.
    """
    if type(message) is not dict:
        raise malformed(field, "a map")
    kind = BY_CODE.get(integer(message, "code"), TransformException)
    facts = {name: value for name, value in mapping(message, "facts").items() if name in FACTS}
    if not all(type(value) in _FACT_TYPES for value in facts.values()):
        raise malformed("facts", "texts, numbers and nil")
    return kind(text(message, "message"), **facts)


def error_reply(instance: str, error: TransformException) -> Message:
    """The reply to a request that failed as a whole."""
    return {"v": 1, "instance": instance, "error": encode_error(error)}


def raise_error(reply: Mapping[str, Any]) -> None:
    """Raise the error that a reply carries, if any."""
    error = reply.get("error")
    if error is not None:
        raise decode_error(error)


def as_transform_exception(error: Exception) -> TransformException:
    """Any exception as one that a reply can carry; a TransformException is returned as it is."""
    if isinstance(error, TransformException):
        return error
    if isinstance(error, (TypeError, ValueError, OverflowError)):
        return InvalidArgumentException(str(error))
    return TransformException(f"internal error: {type(error).__name__}: {error}")
