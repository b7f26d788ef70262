"""The queues of puts: fair, bounded, in order."""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Any

import pytest
import zenoh
from zenoh.handlers import FifoChannel

from tests.processes.ports import free_endpoint
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._core import TransformRows
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf_server.ingest.clock_offsets import ClockOffsets
from zenoh_tf_server.ingest.future_stamps import FutureStamps
from zenoh_tf_server.ingest.ingest import Ingest
from zenoh_tf_server.ingest.put_commits import Outcome, PutCommits, PutCounters
from zenoh_tf_server.ingest.put_queues import LARGE_BYTES, Put, PutQueues
from zenoh_tf_server.ingest.refusals import Refusals
from zenoh_tf_server.limits import Limits

KIB = 1 << 10


def queues(
    queue_bytes: int = 1 << 20, total: int = 8 << 20, puts: int = 1000, wait_s: float = inf
) -> PutQueues:
    return PutQueues(queue_bytes, total, puts, wait_s)


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


def queued(authority: str, number: int, queued_s: float, static: bool = False) -> Put:
    made = put(authority, number, static=static)
    made.queued_s = queued_s
    return made


def drain_at(tested: PutQueues, now_s: float) -> dict[str, list[int]]:
    """The numbers of the puts of each authority that are committed at a time."""
    left: dict[str, list[int]] = {}
    while (turn := tested.take(small_only=True, now_s=now_s)) is not None:
        for each in turn.puts:
            left.setdefault(each.authority, []).append(each.arrival_ns)
        tested.done(turn)
    assert tested.bytes == 0
    return left


def test_stale_puts_are_dropped_oldest_first_when_newer_ones_wait() -> None:
    tested = queues(wait_s=1.0)
    for name in ("late", "a", "b"):
        for number in range(6):
            tested.add(queued(name, number, float(number)))
    tested.add(queued("rare", 0, 0.0))
    left = drain_at(tested, 4.5)
    # The first one may be a burst of its own, until there is another one.
    assert left == {"late": [0, 1, 2, 3, 4, 5], "a": [4, 5], "b": [4, 5], "rare": [0]}
    dropped = tested.take_dropped()
    assert [(each.authority, each.arrival_ns) for each in dropped] == [
        (name, number) for name in "ab" for number in range(4)
    ]
    assert tested.take_dropped() == []


def test_a_burst_of_one_authority_is_never_stale() -> None:
    tested = queues(wait_s=1.0)
    for round_ in range(4):
        now_s = 10.0 * round_
        for number in range(20):
            tested.add(queued("burst", number, now_s))
        tested.add(queued("sensor", 0, now_s + 4.9))
        tested.add(queued("sensor", 1, now_s + 5.0))
        assert drain_at(tested, now_s + 5) == {"burst": list(range(20)), "sensor": [0, 1]}
    assert tested.take_dropped() == []


def test_static_puts_and_first_copies_are_never_stale() -> None:
    tested = queues(wait_s=1.0)
    for number in range(2):
        tested.add(queued("late", number, 0.0))
    copy = queued("copy", 0, 0.0)
    copy.is_history = True
    for each in (copy, queued("copy", 1, 0.0)):
        tested.add(each)
    for number in range(6):
        tested.add(queued("a", number, 0.0, static=number % 2 == 0))
    # Of the dynamic ones, 5 is the newest.
    assert drain_at(tested, 9.0) == {"late": [0, 1], "copy": [0, 1], "a": [0, 2, 4, 5]}
    assert [each.arrival_ns for each in tested.take_dropped()] == [1, 3]


def test_a_put_that_waits_for_long_presses() -> None:
    tested = queues(wait_s=4.0)
    assert not tested.is_full_for("a", 0.25, 9.0)
    tested.add(queued("a", 0, 4.0))
    assert tested.is_full_for("a", 0.25, 5.1) and not tested.is_full_for("a", 0.25, 4.9)


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


class Handler:
    """Zenoh's handler of a channel; `on_try` is called when it is asked for what has come."""

    def __init__(self, handler: Any, on_try: Callable[[], None] = lambda: None) -> None:
        self._handler = handler
        self._on_try = on_try

    def try_recv(self) -> zenoh.Sample | None:
        self._on_try()
        sample: zenoh.Sample | None = self._handler.try_recv()
        return sample


@pytest.fixture
def received() -> Iterator[tuple[Ingest, list[wire.Commit], zenoh.Session, Any]]:
    """An ingest, what it has committed, and a session that puts to a subscriber's handler."""
    limits = Limits()
    committed: list[wire.Commit] = []

    def commit(puts: Sequence[wire.Commit]) -> list[Outcome]:
        committed.extend(puts)
        return [None for _ in puts]

    commits = PutCommits(
        commit, PutCounters(), Refusals(limits), limits, ClockOffsets(), FutureStamps(1.0)
    )
    ingest = Ingest(commits, limits)
    with zenoh.open(zenoh_config.router([free_endpoint()])) as session:
        channel: FifoChannel[zenoh.Sample] = FifoChannel(4)
        subscriber = session.declare_subscriber(keys.all_puts("main"), channel)
        yield ingest, committed, session, subscriber.handler
        subscriber.undeclare()


KEY = keys.put("main", "wheels", static=False)


def message(stamp_ns: int, rows: int = 1) -> bytes:
    """A put of rows with this stamp."""
    stampeds = [
        StampedTransform("map", f"frame{row}", stamp_ns, Transform()) for row in range(rows)
    ]
    return wire.pack(wire.commit_body(wire.Commit(TransformRows.of(stampeds))))


def test_a_put_that_arrives_while_others_are_sorted_is_not_dated_back(received: Any) -> None:
    ingest, committed, session, handler = received
    sent_ns: list[int] = []

    def send_second() -> None:
        if not sent_ns:
            sent_ns.append(time.time_ns())
            session.put(KEY, message(2))

    session.put(KEY, message(1))
    ingest._receive(Handler(handler, send_second), handler.recv())
    if len(committed) < 2:
        ingest._receive(Handler(handler), handler.recv())
    first_ns, second_ns = (commit.max_stamp_ns - 1_000_000_000 for commit in committed)
    assert first_ns <= sent_ns[0] <= second_ns


def test_only_a_put_that_meets_a_queue_is_queued(received: Any) -> None:
    ingest, committed, session, handler = received

    def receive(payload: bytes) -> int:
        session.put(KEY, payload)
        queued: int = ingest._receive(Handler(handler), handler.recv())
        return queued

    assert receive(message(1)) == 0
    assert receive(message(2, rows=4000)) == 1  # needs long
    assert receive(message(3)) == 1  # would overtake it
    assert ingest._serve_small() == 0
    large = ingest._take(small_only=False)
    assert large is not None
    assert receive(message(4)) == 1
    assert ingest._serve([large]) == 1
    assert ingest._serve_small() == 2
    assert receive(message(5)) == 0
    assert [commit.rows.newest_stamp for commit in committed] == [1, 2, 3, 4, 5]
