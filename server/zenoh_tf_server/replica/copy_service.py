"""The service of one copy of the primary's tree: everything but writes.

Thread safety: all methods.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, NoReturn

from zenoh_tf import TransformTree, wire
from zenoh_tf._net import handover
from zenoh_tf.errors import ReadOnlyReplica

from ..process import network
from ..requests.handler import ReplyCallback
from ..requests.service import Service
from ..requests.surroundings import Surroundings
from ..streams.interests import Interests
from ..streams.snapshots import Snapshots
from .relay import Relay

if TYPE_CHECKING:
    from .service import ReplicaService


class CopyService(Service):
    """Serves one copy, and publishes what changes in it."""

    def __init__(
        self,
        replica: ReplicaService,
        tree: TransformTree,
        instance: str,
        settings: wire.TreeSettings,
        offer: handover.Offer | None,
    ) -> None:
        name, limits = replica.name, replica.limits
        self._replica = replica
        self.relay = Relay(replica.feed, tree, instance, limits)
        self.interests = Interests(tree, self.relay, instance, limits)
        snapshots = Snapshots(tree, self.relay, self.interests, instance, settings)
        around = Surroundings(
            is_connected=replica.is_connected,
            addresses=functools.partial(network.addresses, replica.session),
            last_seq=self.relay.last_seq,
            offer=offer,
            reads={"snapshot": snapshots.snapshot, "missed": snapshots.missed},
            identity={"primary": replica.primary},
        )
        super().__init__(
            tree, name, instance, limits, replica.loop, guard=replica.guard, around=around
        )
        self.requests = replica.requests
        for part in (self.relay, self.interests, replica):
            self.add_counters(part.counters)
        self.relay.start(replica.session, name)
        self.interests.start(replica.session, name)

    def close(self) -> None:
        super().close()
        self.interests.close()
        self.relay.close()

    def client_gone(self, client: str) -> None:
        super().client_gone(client)
        self.interests.client_gone(client)

    def check_floor(self, instance: str, seq: int) -> None:
        self._replica.check_floor(instance, seq)

    def _clocks_now(self) -> tuple[int, int]:
        """Those of the primary, as its numbers are."""
        clock = self._replica.feed.clock
        return clock.there_ns(self.instance) or 0, clock.real_ns()

    # --- writes

    def _commit(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        """Compare what a transaction has read, if it only reads."""
        commit = wire.parse_commit(message)
        if len(commit.rows):
            self._refuse()
        reply_to(self._pack({"stored": commit.apply(self.tree)}), False)

    def _batch(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        if any(request_type == "commit" for request_type, _ in wire.parse_batch(message)):
            self._refuse()
        super()._batch(message, reply_to)

    def _admin(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        self._refuse()

    def _refuse(self) -> NoReturn:
        primary = self._replica.primary
        raise ReadOnlyReplica(
            f"this is a replica of tree {self.name!r}, which accepts no writes: connect to its "
            f"primary, {primary}",
            value=primary,
        )
