"""What the tree holds and how its frames move: the `info` requests, except `hello`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.text import quoted

from .clock_offsets import ClockOffsets
from .refusals import Refusals


class InfoRequests:
    """Answers `info` requests from a tree. Thread safety: all methods."""

    def __init__(
        self,
        tree: TransformTree,
        refusals: Refusals,
        clocks: ClockOffsets,
        counters: Callable[[], dict[str, int]],
    ) -> None:
        """`counters`: the server's own counters, added to the tree's in `stats`."""
        self._tree = tree
        self._refusals = refusals
        self._clocks = clocks
        self._counters = counters

    def value(self, message: wire.Message) -> Any:
        """The value that the request asks for. Raises TransformException."""
        tree = self._tree
        what = wire.text(message, "what")
        if what == "frames":
            return tree.frames()
        if what == "frame":
            return tree._frame_record(wire.text(message, "frame"))
        if what == "authorities":
            return self.authorities()
        if what == "parent":
            return tree.parent(wire.text(message, "frame"), _stamp(message))
        if what == "chain":
            target, source = wire.text(message, "target"), wire.text(message, "source")
            return tree.chain(target, source, _stamp(message))
        if what == "velocity":
            return self._velocity(message)
        if what == "stats":
            return tree.stats() | self._counters()
        raise InvalidArgumentException(f"unknown info request {quoted(what)}", field="what")

    def authorities(self) -> list[dict[str, Any]]:
        """What is known of each authority: the fields of `zenoh_tf.AuthorityInfo`."""
        return self._clocks.add_to(self._refusals.add_to(self._tree._authority_records()))

    def _velocity(self, message: wire.Message) -> dict[str, Any]:
        return self._tree._velocity_record(
            wire.text(message, "tracking_frame"),
            wire.text(message, "observation_frame"),
            _stamp(message),
            wire.integer(message, "averaging_interval_ns", low=1),
            _optional_text(message, "reference_frame"),
            wire.column(message, "reference_point", wire.F64, 3),
            _optional_text(message, "reference_point_frame"),
        )


def _stamp(message: wire.Message) -> int | None:
    return wire.integer(message, "stamp_ns") if "stamp_ns" in message else None


def _optional_text(message: wire.Message, field: str) -> str | None:
    return wire.text(message, field) if field in message else None
