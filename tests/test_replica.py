"""Replicas as processes: one server executes each read, and clients read their own writes."""

from __future__ import annotations

import re
import threading
import time
import urllib.request
from collections.abc import Callable

import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf.errors import ReplicaBehind
from zenoh_tf_client import Transaction, TransformClient
from zenoh_tf_client.receipt import Receipt

from .conftest import ServerProcess, StartServer, free_port
from .raw import raw
from .replicas import DEADLINE_S, FRAMES, reads_near, seen, step, wait

READS = 30
FAMILIES = ("lookup", "batch", "info", "commit")
#: Health probes are lookups, too: one every 2 s.
PROBES = 8


# --- who executes


class Counted:
    """A server whose executed requests are counted."""

    def __init__(self, start: Callable[..., ServerProcess]) -> None:
        self._port = free_port()
        self.server = start("--metrics", f"127.0.0.1:{self._port}")

    def counts(self) -> dict[str, int]:
        """How many requests of each family it has executed, whatever came of them."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self._port}/metrics") as page:
            text = page.read().decode()
        pattern = r'^zenoh_tf_requests_total{family="(\w+)",outcome="\w+"} (\S+)$'
        found = dict.fromkeys(FAMILIES, 0)
        for family, count in re.findall(pattern, text, re.MULTILINE):
            found[family] = found.get(family, 0) + int(float(count))
        return found


def counts(servers: list[Counted]) -> list[dict[str, int]]:
    time.sleep(1.1)  # their pages are made once a second
    return [each.counts() for each in servers]


@pytest.mark.parametrize("shape", ["star", "chain", "triangle"])
def test_one_server_executes_each_read(
    shape: str, start_server: StartServer, start_replica: StartServer
) -> None:
    first = Counted(start_server)
    second = Counted(lambda *flags: start_replica(first.server, flags=flags))
    links = {"star": [first], "chain": [second], "triangle": [first, second]}[shape]
    third = Counted(lambda *flags: start_replica(*(each.server for each in links), flags=flags))
    servers = [first, second, third]
    with first.server.connect(10) as tf:
        tf.set_transforms_xact(step(1))
    after = counts(servers)
    for own in servers:
        before = after
        with own.server.connect(10) as tf, raw(own.server.endpoint) as wires:
            assert reads_near(tf) == (own is not first)
            tf.set_transforms_xact(step(tf.lookup_transform("map", FRAMES[0]).stamp_ns + 1))
            for _ in range(READS):
                tf.lookup_transform("map", FRAMES[0])
                with tf.batch() as batch:
                    batch.lookup_transform("map", FRAMES[1])
                tf.frames()
            lookup = wire.pack(wire.one_read("map", FRAMES[0], wire.OP_COMMON, wire.NO_STAMP))
            for _ in range(READS):  # as a client does that knows no replicas
                assert "error" not in wires.query("lookup", lookup)
            after = counts(servers)
        for index, each in enumerate(servers):
            executed = {family: after[index][family] - before[index][family] for family in FAMILIES}
            expected = READS if each is own else 0
            assert executed["batch"] == expected, (shape, index)
            assert executed["info"] == expected, (shape, index)
            assert executed["commit"] == (each is first), (shape, index)
            plain = READS if each is first else 0
            # One more lookup found the stamp; a replica may have refused it once or twice.
            assert expected + plain <= executed["lookup"] <= expected + plain + PROBES + 4


# --- reads and writes through a replica


def test_a_client_reads_its_own_writes(near: TransformClient) -> None:
    for stamp in range(1, 200):
        near.set_transforms_xact(step(stamp))
        assert seen(near) == stamp
        assert reads_near(near)
    assert near.replica_age_s is not None
    assert near.replica_age_s < 5
    near.clear()
    assert near.frame(FRAMES[0]).samples == 0


def test_all_kinds_of_reads(primary: ServerProcess, near: TransformClient) -> None:
    tree = TransformTree()
    with primary.connect(10) as tf:
        for where in (tree, tf):
            for stamp in range(1, 5):
                where.set_transforms_xact(step(stamp * 10**9))
            where.set_transform(StampedTransform("frame1", "tool", 0, Transform((1, 2, 3))))
            where.set_transform(StampedTransform("map", "lamp", 0, Transform()), static=True)
        receipt = tf.last_receipt
    near._connection.exchange._least = receipt
    assert sorted(near.frames()) == sorted(tree.frames())
    assert near.chain("frame1", "frame2") == tree.chain("frame1", "frame2")
    assert near.parent("lamp") == "map"
    assert near.frame("lamp").static
    at = 2_500_000_000
    found = near.sample("frame1", "frame2", [at, at + 1, 9 * 10**9])
    expected = tree.sample("frame1", "frame2", [at, at + 1, 9 * 10**9])
    assert found.status.tolist() == expected.status.tolist()
    assert found.translations[:2].tolist() == expected.translations[:2].tolist()
    assert near.lookup_velocity("frame1", "map", at).linear.tolist() == pytest.approx([1e9, 0, 0])
    assert not near.can_transform("map", "nobody")
    assert {"replica_age_s", "replica_seq", "replica_snapshots"} <= near.stats().keys()
    assert reads_near(near)


def test_a_lookup_waits_at_the_replica(primary: ServerProcess, near: TransformClient) -> None:
    """A put reaches the primary, whose commit ends the wait in the replica."""
    near.set_transforms_xact(step(1))
    found: list[int] = []

    def look_up() -> None:
        found.append(near.lookup_transform("map", FRAMES[0], 5, timeout_s=20).stamp_ns)

    waiting = threading.Thread(target=look_up)
    waiting.start()
    wait(lambda: near.stats()["waiters"] == 1, "the lookup does not wait there")
    near.broadcaster("sensor").send([StampedTransform("map", FRAMES[0], 5, Transform())])
    waiting.join(DEADLINE_S)
    assert found == [5]
    with primary.connect(10) as tf:
        assert [each.name for each in tf.authorities() if each.name] == ["sensor"]


def test_transactions_of_clients_everywhere(primary: ServerProcess, replica: ServerProcess) -> None:
    """What was read in a replica is validated by the primary."""
    rounds = 25
    with primary.connect(20) as tf:
        tf.set_transform(StampedTransform("map", "count", 1, Transform()))

    def add(server: ServerProcess) -> None:
        with server.connect(20) as tf:
            for _ in range(rounds):
                tf.run_transaction(one_more, attempts=1000)

    def one_more(tx: Transaction) -> None:
        latest = tx.lookup_latest_transform_xact("map", "count")
        x = latest.transform.translation[0] + 1
        stamped = StampedTransform("map", "count", latest.stamp_ns + 1, Transform((x, 0, 0)))
        tx.set_transform(stamped)

    threads = [threading.Thread(target=add, args=(each,)) for each in (primary, replica, replica)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with primary.connect(10) as tf:
        pose = tf.lookup_latest_transform("map", "count").transform
        assert pose.translation[0] == 3 * rounds


def test_a_replica_that_lacks_a_write(primary: ServerProcess, near: TransformClient) -> None:
    """It refuses the read, and the client asks the primary."""
    near.set_transforms_xact(step(1))
    receipt = near.last_receipt
    assert receipt is not None
    near._connection.exchange._least = Receipt(receipt.instance, receipt.seq + 1000)
    assert seen(near) == 1
    assert near.replica_age_s is None  # the primary's own reply
    primary.kill()
    with pytest.raises(ReplicaBehind, match=r"commit 1001 .* it has 1") as refusal:
        seen(near)
    assert (refusal.value.limit, refusal.value.value) == (receipt.seq + 1000, receipt.seq)
