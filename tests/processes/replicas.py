"""What the tests of replicas share: transforms that change together, and waiting."""

from __future__ import annotations

from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

DEADLINE_S = 40.0
FRAMES = [f"frame{i}" for i in range(10)]


def step(stamp: int) -> list[StampedTransform]:
    """Transforms that always change together."""
    return [StampedTransform("map", name, stamp, Transform((stamp, 0, 0))) for name in FRAMES]


def seen(tf: TransformClient) -> int:
    """The stamp of the last step; all frames must be of it."""
    found = tf.lookup_latest_transforms_xact([("map", name) for name in FRAMES])
    stamps = {one.stamp_ns for one in found}
    assert len(stamps) == 1, stamps
    return stamps.pop()


def wait_for_writes(writer: TransformClient, reader: TransformClient) -> None:
    """Wait until a replica has what another client has written to its primary."""
    receipt = writer.last_receipt
    assert receipt is not None

    def is_there() -> bool:
        has = reader.stats().get("replica_seq", 0)
        return reader.instance == receipt.instance and has >= receipt.seq

    wait_until(is_there, "the replica does not receive what was written")
