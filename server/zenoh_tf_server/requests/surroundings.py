"""What a service gets from the server around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from zenoh_tf import wire
from zenoh_tf._net import handover


@dataclass(frozen=True)
class Surroundings:
    """The rest of the server, as a service sees it; by default there is none."""

    #: Whether a client's token is there.
    is_connected: Callable[[str], bool] = lambda client: True
    #: The addresses of the clients by their ids.
    addresses: Callable[[], Mapping[str, str]] = dict
    #: The robots whose servers are not heard, and for how many seconds.
    lost_robots: Callable[[], Mapping[str, float]] = dict
    #: Number of the tree's last commit, for the replies to writes.
    last_seq: Callable[[], int] | None = None
    #: Called with each commit that the tree has applied, and what became of its rows.
    on_commit: Callable[[wire.Commit, bytes], None] | None = None
    #: Where clients of this host can map the tree.
    offer: handover.Offer | None = None
    #: More types of requests: each function makes the fields of a reply to a client.
    reads: Mapping[str, Callable[[wire.Message, str], wire.Message]] = field(default_factory=dict)
    #: More fields of the reply to `hello`.
    identity: Mapping[str, object] = field(default_factory=dict)


ALONE = Surroundings()
