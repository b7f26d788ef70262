"""After random traffic a mirror's tree is the server's: frames, histories and versions. During
the traffic, what the mirror reads are states that the server has had, in order."""

from __future__ import annotations

import functools
import random
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.support.runs import FRAME_LOCKS
from tests.support.threads import beside, together
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import TransformException
from zenoh_tf_client import Mirror, TransformClient

DEADLINE_S = 60.0
SECOND_NS = 1_000_000_000
#: Fewer than what the server holds at once, and more than it ever may: names come and go.
NAMES = [f"frame{i}" for i in range(40)]
VISITORS = 300


class Traffic:
    """Random writes of one client. Remembers all stamps, so that histories can be compared."""

    def __init__(self, tf: TransformClient, seed: int) -> None:
        self._tf = tf
        self._random = random.Random(seed)
        self._seed = seed
        self._sensor = tf.broadcaster(f"sensor{seed}")
        self.now_ns = 100 * SECOND_NS
        self.stamps: set[int] = set()
        self.names = {"map"}

    def run(self, steps: int) -> None:
        writes = [self._one] * 6 + [self._many] * 4 + [self._put] * 6
        writes += [self._visitor] * 6 + [self._remove, self._remove, self._jump, self._clear]
        for _ in range(steps):
            self.now_ns += self._random.randrange(SECOND_NS // 10)
            try:
                self._random.choice(writes)()
            except TransformException:  # a cycle, a late stamp, children, the limit of frames
                continue

    def _stamped(self, name: str | None = None) -> StampedTransform:
        child = name or self._random.choice(NAMES)
        parents = ["map", *NAMES[: NAMES.index(child)]] if child in NAMES else ["map"]
        stamp = self.now_ns - self._random.choice((0, 0, 0, SECOND_NS, 20 * SECOND_NS))
        self.stamps.add(stamp)
        self.names.add(child)
        pose = Transform(tuple(self._random.uniform(-9, 9) for _ in range(3)))
        return StampedTransform(self._random.choice(parents), child, stamp, pose)

    def _one(self) -> None:
        self._tf.set_transform(self._stamped(), "calls", static=self._random.random() < 0.1)

    def _many(self) -> None:
        self._tf.set_transforms_xact([self._stamped() for _ in range(self._random.randrange(9))])

    def _put(self) -> None:
        self._sensor.send([self._stamped() for _ in range(self._random.randrange(1, 9))])

    def _visitor(self) -> None:
        name = f"visitor{self._seed}/{self._random.randrange(VISITORS)}"
        self._tf.set_transform(self._stamped(name))
        if self._random.random() < 0.9:
            self._tf.remove_frame(name)

    def _remove(self) -> None:
        self._tf.remove_frame(self._random.choice(NAMES), subtree=self._random.random() < 0.5)

    def _jump(self) -> None:
        """Time is set back: the second of two old samples clears the history."""
        child = self._random.choice(NAMES)
        for i in range(2):
            stamp = self.now_ns - 50 * SECOND_NS + i
            self.stamps.add(stamp)
            self._tf.set_transform(StampedTransform("map", child, stamp, Transform()))

    def _clear(self) -> None:
        if self._random.random() < 0.3:
            self._tf.clear(keep_static=self._random.random() < 0.5)
        elif self._random.random() < 0.2:
            self._tf.reset()


def assert_equal(m: Mirror, tf: TransformClient, stamps: list[int]) -> None:
    """Compare everything that a client can see of a frame, and its whole history."""
    assert sorted(m.frames()) == sorted(tf.frames())
    for name in tf.frames():
        mine, servers = m.frame(name), tf.frame(name)
        for field in (
            "parent",
            "authority",
            "static",
            "samples",
            "oldest_stamp_ns",
            "newest_stamp_ns",
            "version",
        ):
            assert getattr(mine, field) == getattr(servers, field), (name, field)
        if servers.parent is None:
            continue
        here = m.sample(servers.parent, name, stamps)
        there = tf.sample(servers.parent, name, stamps)
        assert np.array_equal(here.status, there.status), name
        found = here.status == 0
        assert np.array_equal(here.translations[found], there.translations[found]), name


@pytest.mark.parametrize("concurrency", FRAME_LOCKS)
def test_equal_after_random_traffic(start_server: StartServer, concurrency: str) -> None:
    server = start_server(
        *("--concurrency", concurrency, "--limit", "frames=128", "--time-jump", "clear"),
        *("--limit", "samples_per_frame=20"),
    )
    seed = random.randrange(1 << 30)
    print(f"seed {seed}")
    clients = [server.connect(20) for _ in range(3)]
    traffics = [Traffic(tf, seed + i) for i, tf in enumerate(clients)]
    early = clients[0].mirror()
    with ThreadPoolExecutor() as pool:
        running = [pool.submit(traffic.run, 500) for traffic in traffics]
        time.sleep(0.3)
        late = clients[1].mirror()  # its snapshot is taken while others write
    for each in running:
        each.result()
    with server.connect(20) as tf:
        wait_until_quiet(tf)
        stamps = sorted(set().union(*(traffic.stamps for traffic in traffics)))
        # A write after all others, whose receipt both mirrors wait for.
        tf.set_transform(StampedTransform("map", "last", 1, Transform()), static=True)
        for m in (early, late):
            m.wait_for(tf.last_receipt, DEADLINE_S)
            assert_equal(m, tf, stamps)
    for client in clients:
        client.close()


def wait_until_quiet(tf: TransformClient) -> None:
    """Wait until the puts are applied."""
    deadline = time.monotonic() + DEADLINE_S
    before = -1
    while (now := tf.stats()["commits"]) != before:
        assert time.monotonic() < deadline
        before = now
        time.sleep(0.3)


NUMBERED = [f"frame{i}" for i in range(8)]


def numbered(number: int) -> list[StampedTransform]:
    return [StampedTransform("map", n, number, Transform((number, 0, 0))) for n in NUMBERED]


def count_up(tf: TransformClient, by_seq: dict[int, int]) -> None:
    """Commit numbers, each the successor of the one that is read."""
    for _ in range(150):
        written: list[int] = []

        def step(tx: object, written: list[int] = written) -> None:
            newest = tx.lookup_latest_transform_xact("map", "frame0")  # type: ignore[attr-defined]
            written[:] = [newest.stamp_ns + 1]
            for one in numbered(written[0]):
                tx.set_transform(one)  # type: ignore[attr-defined]

        tf.run_transaction(step, attempts=1000)
        assert tf.last_receipt is not None
        by_seq[tf.last_receipt.seq] = written[0]


def test_reads_are_a_prefix_in_order(server: ServerProcess) -> None:
    """Two clients write one sequence of numbers by turns: each commit has all frames and numbers,
    and reads them back, so the numbers are the serial order. Readers of mirrors must see whole
    commits, never an older one after a newer one, and none before the number of `seq`."""
    writers = [server.connect(20) for _ in range(2)]
    writers[0].set_transforms_xact(numbered(1))
    by_seq: dict[int, int] = {}  # the number of each commit, by its receipt
    seen: list[tuple[int, int, int]] = []

    def read(m: Mirror, ending: threading.Event) -> None:
        last = 0
        while not ending.is_set():
            before = m.seq
            found = m.lookup_latest_transforms_xact([("map", name) for name in NUMBERED])
            numbers = {one.stamp_ns for one in found}
            number = found[0].stamp_ns
            assert len(numbers) == 1, "torn"
            assert number >= last
            seen.append((before, number, m.seq))
            last = number
            time.sleep(0.0005)

    mirrors = [server.connect(20).mirror() for _ in range(2)]
    with beside(*(functools.partial(read, m) for m in mirrors)):
        together(*(functools.partial(count_up, tf, by_seq) for tf in writers))
        for m in mirrors:
            for tf in writers:
                m.wait_for(tf.last_receipt, DEADLINE_S)
            assert m.lookup_transform("map", "frame0").stamp_ns == max(by_seq.values())
    # A receipt's number is not below its commit's: what `seq` has reached must be read.
    receipts = sorted(by_seq)
    for before, number, _ in seen:
        reached = [by_seq[seq] for seq in receipts if seq <= before]
        assert number >= max(reached, default=1)
    assert len({number for _, number, _ in seen}) > 50, "too few states were seen"
    for tf in writers:
        tf.close()
    for m in mirrors:
        m._connection.close()
