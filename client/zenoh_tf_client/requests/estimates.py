"""Makes the requests of estimates. Each function serves the client method of the same name."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from zenoh_tf import Estimate, EstimateArray, _core, wire
from zenoh_tf.errors import ProtocolError
from zenoh_tf.estimate import check, estimate_of, max_by_ns

from . import columns
from .request import Call, Request


def estimate_transform(
    target: str,
    source: str,
    stamp_ns: int | None = None,
    *,
    level: float = 0.9,
    max_by_s: float = 0.5,
    max_error_m: float | None = None,
    max_error_rad: float | None = None,
    min_level: float | None = None,
    radius_m: float = 0.0,
) -> Request[Estimate]:
    least = level if min_level is None else min_level
    body = wire.call_body(
        "estimate",
        target=target,
        source=source,
        stamp_ns=columns.optional_stamp(stamp_ns),
        level=level,
        max_by_ns=max_by_ns(max_by_s),
        radius_m=radius_m,
    )

    def parse(reply: wire.Message) -> Estimate:
        record = wire.parse_value(reply, dict)
        try:
            estimate = estimate_of(record)
        except (KeyError, TypeError, ValueError) as error:
            raise ProtocolError(
                f"the estimate in the reply is malformed: {error!r}", field="value"
            ) from error
        return check(estimate, max_error_m, max_error_rad, least)

    return Call("info", body, parse)


def estimate_transforms(
    targets: str | Sequence[str],
    sources: str | Sequence[str],
    stamps_ns: ArrayLike | None,
    *,
    level: float = 0.9,
    max_by_s: float = 0.5,
    radius_m: float = 0.0,
) -> Request[EstimateArray]:
    rows = columns.rows(targets, sources, stamps_ns)
    names, target, source = _core.columns_of_pairs(targets, sources, rows)
    stamps = None if stamps_ns is None else columns.stamps(stamps_ns, rows)
    ask = wire.Estimates(names, target, source, stamps, level, max_by_ns(max_by_s), radius_m)

    def parse(reply: wire.Message) -> EstimateArray:
        found = wire.parse_estimates_reply(reply, rows)
        return EstimateArray.of_columns(found, targets, sources)

    return Call("info", wire.estimates_body(ask), parse)
