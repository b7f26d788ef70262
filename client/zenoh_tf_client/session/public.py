"""The names under which users know methods."""

from __future__ import annotations

from types import FunctionType
from typing import TypeVar

C = TypeVar("C", bound=type)


def own_methods(kind: C) -> C:
    """Decorate a public class whose methods are in internal bases of it alone: errors of a call,
    such as that of an unknown keyword, name the public method."""
    for base in kind.__mro__[1:]:
        for name, member in vars(base).items():
            if isinstance(member, FunctionType) and base.__module__.startswith("zenoh_tf_client"):
                member.__qualname__ = f"{kind.__name__}.{name}"
    return kind
