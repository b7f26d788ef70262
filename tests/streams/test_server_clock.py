"""The age of mirrors, from the clocks of servers that were compared."""

from __future__ import annotations

import math

import pytest

from zenoh_tf._net import server_clock
from zenoh_tf._net.server_clock import COMPARISONS, ServerClock

MS = 1_000_000
#: The server's clock is ahead by this.
AHEAD_NS = 5_000 * MS


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """This machine's clock."""
    now = [0]
    monkeypatch.setattr(server_clock, "now_ns", lambda: now[0])
    return now


def compare(clock: ServerClock, here: list[int], there_ms: int, back_ms: int) -> None:
    """A round trip whose two directions last this long."""
    begin = here[0]
    here[0] += there_ms * MS
    server = here[0] + AHEAD_NS
    here[0] += back_ms * MS
    clock.compared("server", begin, server)


def test_the_age_is_too_large_by_the_way_there(here: list[int]) -> None:
    clock = ServerClock()
    assert math.isinf(clock.age_s("server", 0))
    compare(clock, here, 20, 70)
    state = here[0] + AHEAD_NS
    here[0] += 1000 * MS
    assert clock.age_s("server", state) == pytest.approx(1.020, abs=0.001)
    compare(clock, here, 2, 300)  # a better one
    assert clock.age_s("server", here[0] + AHEAD_NS) == pytest.approx(0.002, abs=0.001)
    compare(clock, here, 50, 1)
    assert clock.age_s("server", here[0] + AHEAD_NS) == pytest.approx(0.002, abs=0.001)


def test_old_comparisons_are_forgotten(here: list[int]) -> None:
    clock = ServerClock()
    compare(clock, here, 1, 1)
    for _ in range(COMPARISONS):
        compare(clock, here, 9, 1)
    assert clock.age_s("server", here[0] + AHEAD_NS) == pytest.approx(0.009, abs=0.001)


def test_the_age_grows_with_the_drift(here: list[int]) -> None:
    clock = ServerClock()
    compare(clock, here, 1, 1)
    here[0] += 100_000 * MS
    assert clock.age_s("server", here[0] + AHEAD_NS) == pytest.approx(0.011, abs=0.001)


def test_the_server_before_is_still_known(here: list[int]) -> None:
    clock = ServerClock()
    compare(clock, here, 1, 1)
    clock.compared("next", here[0], here[0] + 7)
    assert clock.age_s("server", here[0] + AHEAD_NS) < 1
    assert clock.age_s("next", here[0]) < 1
    clock.compared("third", here[0], here[0])
    assert math.isinf(clock.age_s("server", 0))
