"""The server's memory of the stream's latest messages."""

from __future__ import annotations

import random

from zenoh_tf_server.streams.publisher import RecentMessages

COST = 300  # of a message of 100 bytes


def test_the_messages_from_a_number_on() -> None:
    recent = RecentMessages(10 * COST)
    assert recent.since(1, 1 << 20) == []
    for i in range(20):
        recent.add(3 * i + 1, 3 * i + 3, bytes([i]) * 100)
    assert recent.bytes == 10 * COST
    assert recent.since(30, 1 << 20) == []  # forgotten
    assert [data[0] for data in recent.since(31, 1 << 20)] == list(range(10, 20))
    for number in (34, 35, 36):
        assert [data[0] for data in recent.since(number, 1 << 20)] == list(range(11, 20))
    assert [data[0] for data in recent.since(34, COST + 1)] == [11, 12]
    assert recent.since(61, 1 << 20) == []  # not there yet
    recent.clear()
    assert recent.bytes == 0
    assert recent.since(34, 1 << 20) == []


def test_a_message_above_the_bound_is_not_kept() -> None:
    recent = RecentMessages(2 * COST)
    recent.add(1, 1, bytes(100))
    recent.add(2, 2, bytes(1000))
    assert recent.bytes == 0
    recent.add(3, 3, bytes(100))
    assert recent.since(2, 1 << 20) == []
    assert len(recent.since(3, 1 << 20)) == 1


def test_against_a_list_of_all() -> None:
    rng = random.Random(1)
    recent = RecentMessages(50 * COST)
    last = 0
    everything: list[tuple[int, int, bytes]] = []
    for _ in range(2000):
        first, last = last + 1, last + rng.randrange(1, 4)
        everything.append((first, last, bytes([first % 256]) * rng.randrange(500)))
        recent.add(*everything[-1])
        assert 0 <= recent.bytes <= 50 * COST
        number = max(1, last - rng.randrange(300))
        found = recent.since(number, 1 << 30)
        expected = [data for _, end, data in everything if end >= number]
        assert found in ([], expected)
        assert found or number < last - 10
