"""The steps of an exchange: what to do next, for whoever takes them."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, TypeVar

import zenoh

T = TypeVar("T")


@dataclass(slots=True)  # a frozen one takes three times as long to make
class Ask:
    """A step: send a query. Its outcome is the reply, or a `NoReply`."""

    key: zenoh.KeyExpr
    payload: bytes
    timeout_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """A step: wait. It has no outcome."""

    seconds: float


#: The steps to a result. An error of a step is raised where the generator yielded it.
Steps = Generator[Ask | Pause, Any, T]
