"""Messages of many estimates as columns (docs/reference/protocol.md, "info, hello and admin"), and
of limits of motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .calls import call_body, parse_value
from .fields import (
    F64,
    I64,
    U8,
    U32,
    Message,
    column,
    indexes,
    integer,
    malformed,
    mapping,
    number,
    raw,
    texts,
)

#: The columns of a reply in their order: name, type and numbers in a row.
_COLUMNS: Final[tuple[tuple[str, np.dtype[Any], int], ...]] = (
    ("status", U8, 1),
    ("stamp", I64, 1),
    ("pose", F64, 7),
    ("error_m", F64, 1),
    ("error_rad", F64, 1),
    ("level", F64, 1),
    ("backtests", I64, 1),
    ("by_ns", I64, 1),
)
#: Bytes of a row in a reply.
ESTIMATE_BYTES: Final = sum(dtype.itemsize * width for _, dtype, width in _COLUMNS)

#: By the child of a link its speed, acceleration, angular velocity and angular acceleration, at
#: most, in m, s and rad; infinite where there is no limit. And by how many seconds the clock that
#: stamps it may be off.
MotionLimits = Mapping[str, tuple[float, float, float, float, float]]


@dataclass(slots=True)
class Estimates:
    """The questions of one request, as columns."""

    names: list[str]
    target: NDArray[np.uint32]  # (n,) indexes into names
    source: NDArray[np.uint32]  # (n,)
    stamp: NDArray[np.int64] | None  # (n,) ns; None: now
    level: float
    max_by_ns: int
    radius_m: float


def estimates_body(ask: Estimates) -> Message:
    """The body of the request `estimates`."""
    return call_body(
        "estimates",
        names=ask.names,
        target=raw(ask.target, U32),
        source=raw(ask.source, U32),
        stamp=None if ask.stamp is None else raw(ask.stamp, I64),
        level=ask.level,
        max_by_ns=ask.max_by_ns,
        radius_m=ask.radius_m,
    )


def parse_estimates(body: Message) -> Estimates:
    """What `estimates_body` has made."""
    names = texts(body, "names")
    target = indexes(body, "target", None, len(names))
    return Estimates(
        names,
        target,
        indexes(body, "source", target.size, len(names)),
        column(body, "stamp", I64, target.size) if "stamp" in body else None,
        number(body, "level"),
        integer(body, "max_by_ns", low=0),
        number(body, "radius_m"),
    )


def estimates_value(columns: Sequence[NDArray[Any]]) -> Message:
    """The value of the reply: (n,) columns in the order of `_COLUMNS`, the poses (n, 7)."""
    return {
        name: raw(values, dtype) for (name, dtype, _), values in zip(_COLUMNS, columns, strict=True)
    }


def parse_estimates_reply(reply: Message, rows: int) -> list[NDArray[Any]]:
    """The columns in a reply. Raises the error that it carries, if any."""
    value = parse_value(reply, dict)
    columns = [column(value, name, dtype, rows, width) for name, dtype, width in _COLUMNS]
    columns[2] = columns[2].reshape(rows, 7)
    return columns


def motion_limits_fields(limits: MotionLimits) -> Message:
    """The fields of a message that has limits of motion, if there are any."""
    columns = {child: raw(np.array(values), F64) for child, values in limits.items()}
    return {"motion_limits": columns} if columns else {}


def parse_motion_limits(message: Message) -> MotionLimits:
    """The limits of motion in a message."""
    if "motion_limits" not in message:
        return {}
    fields = mapping(message, "motion_limits")
    limits = {child: column(fields, child, F64, 5) for child in fields}
    if not all((values >= 0).all() for values in limits.values()):
        raise malformed("motion_limits", "numbers, 0 or more")
    return {child: tuple(values.tolist()) for child, values in limits.items()}
