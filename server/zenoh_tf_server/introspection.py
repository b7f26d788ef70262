"""What the tree holds, and how it moves: the `info` requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from zenoh_tf import wire
from zenoh_tf.errors import InvalidArgumentException

if TYPE_CHECKING:
    from .service import Service


def answer(service: Service, message: wire.Message) -> Any:
    """The value that an `info` request asks for."""
    tree = service.tree
    what = wire.text(message, "what")
    if what == "frames":
        return tree.frames()
    if what == "frame":
        return tree._frame_record(wire.text(message, "frame"))
    if what == "authorities":
        return tree._authority_records()
    if what == "parent":
        return tree.parent(wire.text(message, "frame"), _stamp(message))
    if what == "chain":
        target, source = wire.text(message, "target"), wire.text(message, "source")
        return tree.chain(target, source, _stamp(message))
    if what == "velocity":
        return _velocity(service, message)
    if what == "stats":
        return {
            **tree.stats(),
            "outcomes": len(service.outcomes),
            **service.puts.as_dict(),
        }
    raise InvalidArgumentException(f"no information {what!r}", field="what")


def _velocity(service: Service, message: wire.Message) -> dict[str, Any]:
    return service.tree._velocity_record(
        wire.text(message, "tracking_frame"),
        wire.text(message, "observation_frame"),
        _stamp(message),
        wire.integer(message, "averaging_interval_ns", low=1),
        wire.text(message, "reference_frame") if "reference_frame" in message else None,
        wire.column(message, "reference_point", wire.F64, 3),
        wire.text(message, "reference_point_frame") if "reference_point_frame" in message else None,
    )


def _stamp(message: wire.Message) -> int | None:
    return wire.integer(message, "stamp_ns") if "stamp_ns" in message else None
