"""The queues of puts: fair, bounded, in order."""

from __future__ import annotations

import random
import time
from collections import Counter

import zenoh
from zenoh.handlers import FifoChannel

from tests.processes.ports import free_endpoint
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf_server.ingest.clock_offsets import ClockOffsets
from zenoh_tf_server.ingest.future_stamps import FutureStamps
from zenoh_tf_server.ingest.ingest import Ingest, PutCounters
from zenoh_tf_server.ingest.put_queues import LARGE_BYTES, Put, PutQueues
from zenoh_tf_server.ingest.refusals import Refusals
from zenoh_tf_server.limits import Limits

KIB = 1 << 10


def queues(queue_bytes: int = 1 << 20, total: int = 8 << 20, puts: int = 1000) -> PutQueues:
    return PutQueues(queue_bytes, total, puts)


def put(authority: str, number: int = 0, size: int = 100, static: bool = False) -> Put:
    return Put(authority, static, b"", size, number)


def drain(tested: PutQueues, *, small_only: bool = False) -> list[Put]:
    taken: list[Put] = []
    while (turn := tested.take(small_only=small_only)) is not None:
        taken += turn.puts
        tested.done(turn)
    return taken


def test_a_sensor_does_not_wait_behind_a_flood() -> None:
    tested = queues()
    for number in range(500):
        tested.add(put("flood", number))
    flood = tested.take(small_only=True)
    assert flood is not None
    tested.add(put("sensor"))
    tested.done(flood)
    order = [each.authority for each in drain(tested)]
    assert order.index("sensor") < 40


def test_each_authority_gets_its_share_of_the_work() -> None:
    tested = queues()
    for number in range(64):
        tested.add(put("large rows", number, 15 * KIB))
        for part in range(16):
            tested.add(put("small rows", 16 * number + part, 100))
    work: Counter[str] = Counter()
    while work.total() < 600 * KIB:
        turn = tested.take(small_only=True)
        assert turn is not None
        work[turn.puts[0].authority] += turn.cost
        tested.done(turn)
    assert 0.7 < work["large rows"] / work["small rows"] < 1.4


def test_the_order_of_an_authority_is_kept() -> None:
    rng = random.Random(1)
    tested = queues()
    numbers: Counter[str] = Counter()
    left: list[Put] = []
    for _ in range(3000):
        if rng.random() < 0.5:
            name = rng.choice("abc")
            size = rng.choice((10, 1000, LARGE_BYTES + 1)) if rng.random() < 0.1 else 50
            assert not tested.add(put(name, numbers[name], size, static=rng.random() < 0.3))
            numbers[name] += 1
        elif (turn := tested.take(small_only=rng.random() < 0.5)) is not None:
            other = tested.take(small_only=True)
            if other is not None:
                assert other.puts[0].authority != turn.puts[0].authority
                left += other.puts
                tested.done(other)
            left += turn.puts
            tested.done(turn)
        if tested.bytes > 700 * KIB:
            left += drain(tested)
    left += drain(tested)
    for name in "abc":
        assert [each.arrival_ns for each in left if each.authority == name] == list(
            range(numbers[name])
        )
    assert tested.bytes == 0


def test_a_full_queue_drops_its_oldest_dynamic_puts() -> None:
    tested = queues(queue_bytes=1000)
    assert not tested.add(put("a", 0, static=True))
    for number in range(1, 10):
        assert not tested.add(put("a", number))
    assert not tested.add(put("b", 0))
    assert [each.arrival_ns for each in tested.add(put("a", 10))] == [1]
    assert [each.arrival_ns for each in tested.add(put("a", 11, 250))] == [2, 3, 4]
    assert [e.arrival_ns for e in drain(tested) if e.authority == "a"] == [0, 5, 6, 7, 8, 9, 10, 11]
    assert tested.bytes == 0


def test_static_puts_are_refused_but_not_dropped() -> None:
    tested = queues(queue_bytes=1000)
    for number in range(10):
        assert not tested.add(put("a", number, static=True))
    refused = put("a", 10, static=True)
    assert tested.add(refused) == [refused]
    assert len(drain(tested)) == 10


def test_the_total_takes_from_the_longest_queue() -> None:
    tested = queues(queue_bytes=1000, total=1200)
    for number in range(9):
        tested.add(put("a", number))
    for number in range(3):
        tested.add(put("b", number))
    assert [(e.authority, e.arrival_ns) for e in tested.add(put("b", 3))] == [("a", 0)]
    assert tested.bytes == 1200
    assert len(drain(tested)) == 12


def test_large_puts_are_left_to_the_other_thread() -> None:
    tested = queues()
    tested.add(put("a", 0, LARGE_BYTES + 1))
    tested.add(put("a", 1))
    tested.add(put("b", 0))
    turn = tested.take(small_only=True)
    assert turn is not None and turn.puts[0].authority == "b"
    assert tested.take(small_only=True) is None
    assert tested.has_large and not tested.has_small
    large = tested.take(small_only=False)
    assert large is not None and [each.arrival_ns for each in large.puts] == [0]
    assert tested.take(small_only=True) is None  # put 1 of "a" must not overtake it
    tested.done(large)
    tested.done(turn)
    assert [each.arrival_ns for each in drain(tested, small_only=True)] == [1]


def test_more_authorities_than_queues() -> None:
    tested = queues(puts=10_000)
    for number in range(3):
        for name in range(2000):
            assert not tested.add(put(str(name), number))
    taken = drain(tested)
    assert len(taken) == 6000
    numbers: dict[str, list[int]] = {}
    for each in taken:
        numbers.setdefault(each.authority, []).append(each.arrival_ns)
    assert all(each == [0, 1, 2] for each in numbers.values())
    assert tested.bytes == 0


def test_a_put_that_arrives_while_others_are_sorted_is_not_dated_back() -> None:
    limits = Limits()
    clocks, future = ClockOffsets(), FutureStamps()
    ingest = Ingest(lambda *_: None, PutCounters(), Refusals(limits), limits, clocks, future)
    key = keys.put("main", "wheels", static=False)
    sent_ns: list[int] = []

    class Handler:
        """Zenoh's handler; a second put is sent when it is asked for one."""

        def try_recv(self) -> zenoh.Sample | None:
            if sent_ns:
                return None
            sent_ns.append(time.time_ns())
            session.put(key, b"second")
            return subscriber.handler.recv()

    with zenoh.open(zenoh_config.router([free_endpoint()])) as session:
        channel: FifoChannel[zenoh.Sample] = FifoChannel(4)
        subscriber = session.declare_subscriber(keys.all_puts("main"), channel)
        session.put(key, b"first")
        ingest._receive(Handler(), subscriber.handler.recv())
        subscriber.undeclare()
    turn = ingest._queues.take(small_only=True)
    assert turn is not None
    first, second = turn.puts
    assert first.arrival_ns <= sent_ns[0] <= second.arrival_ns
