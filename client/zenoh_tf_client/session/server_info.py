"""What a client knows of the server that answered last."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NoReturn

from zenoh_tf import wire
from zenoh_tf._net import handover
from zenoh_tf.errors import LimitExceeded, ReadOnlyReplica


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """The server that answered last."""

    instance: str
    clock_ns: int  # the server's, when it replied
    clock_offset_ns: int  # the server's clock minus this one's, rounded down
    message_bytes: int
    rows: int  # transforms in one message
    offer: handover.Offer | None = None  # of its tree's memory
    seq: int | None = None  # the number of its last commit, when it replied
    real_ns: int | None = None  # its real-time clock, when it replied
    primary: str | None = None  # where writes are accepted, if not here

    def too_long(self, size: int) -> LimitExceeded:
        """The error of a request that is longer than `message_bytes`."""
        return LimitExceeded(
            f"a message of {size:,} bytes exceeds the server's limit of {self.message_bytes:,} "
            "bytes (--limit message_bytes=N)",
            field="message_bytes",
            limit=self.message_bytes,
            value=size,
        )

    def raise_read_only(self) -> NoReturn:
        """Raise the error of a write where the server accepts none."""
        raise ReadOnlyReplica(
            f"the server accepts no writes: connect to its primary, {self.primary}",
            value=self.primary,
        )


def parse_server_info(value: dict[str, Any], now_ns: int) -> ServerInfo:
    """Who a server is, by its reply to `hello`, which arrived at `now_ns`."""
    # The server read its clock before this side did, so the offset is too small by the reply's
    # travel time at most. An expiry computed with it is never later than this side's own time-out.
    clock_ns = wire.integer(value, "clock_ns")
    limits = wire.mapping(value, "limits")
    return ServerInfo(
        wire.text(value, "instance"),
        clock_ns,
        clock_ns - now_ns,
        wire.integer(limits, "message_bytes"),
        wire.integer(limits, "rows"),
        handover.parse_offer(value.get(handover.HELLO_FIELD)),
        wire.integer(value, "seq") if "seq" in value else None,
        wire.integer(value, "real_ns") if "real_ns" in value else None,
        wire.text(value, "primary") if "primary" in value else None,
    )
