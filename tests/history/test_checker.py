"""The checker on histories written by hand: each kind of anomaly, and what is none."""

from __future__ import annotations

import pytest

from .by_hand import history, transaction
from .checker import describe, find_anomaly
from .history import CONFLICT, FROM_A_MIRROR, INCONSISTENT, liveliness

#: All overlap, so that only what they read and wrote orders them.
TOGETHER = (0, 100)

ANOMALIES = {
    "G0 dirty write": history(
        transaction(TOGETHER, writes={0: 1, 1: 4}), transaction(TOGETHER, writes={0: 2, 1: 3})
    ),
    "G1a aborted read": history(
        transaction(TOGETHER, writes={0: 1}, outcome=CONFLICT), transaction(TOGETHER, reads={0: 1})
    ),
    "unwritten version": history(
        transaction(TOGETHER, writes={0: 1}), transaction(TOGETHER, reads={1: 1})
    ),
    "G1c circular information flow": history(
        transaction(TOGETHER, reads={1: 2}, writes={0: 1}),
        transaction(TOGETHER, reads={0: 1}, writes={1: 2}),
    ),
    "G-single read skew": history(
        transaction(TOGETHER, writes={0: 1, 1: 1}), transaction(TOGETHER, reads={0: 1, 1: 0})
    ),
    "lost update": history(
        transaction(TOGETHER, reads={0: 0}, writes={0: 1}),
        transaction(TOGETHER, reads={0: 0}, writes={0: 2}),
        in_order=False,
    ),
    "G2 write skew": history(
        transaction(TOGETHER, reads={0: 0, 1: 0}, writes={0: 1}),
        transaction(TOGETHER, reads={0: 0, 1: 0}, writes={1: 2}),
    ),
    "stale read": history(transaction((0, 10), writes={0: 1}), transaction((20, 30), reads={0: 0})),
    "order against real time": history(
        transaction((20, 30), writes={0: 1}), transaction((0, 10), reads={0: 1})
    ),
    "a session goes back": history(
        transaction((0, 10), writes={0: 1}),
        transaction((FROM_A_MIRROR, 30), reads={0: 1}, thread=9),
        transaction((FROM_A_MIRROR, 50), reads={0: 0}, thread=9),
    ),
    "inconsistent result": history(transaction(TOGETHER, outcome=INCONSISTENT)),
}


@pytest.mark.parametrize("name", ANOMALIES)
def test_an_anomaly_is_found_and_named(name: str) -> None:
    anomaly = find_anomaly(ANOMALIES[name])
    assert anomaly is not None
    assert anomaly.name == name
    for number in anomaly.transactions:
        assert f"T{number}: thread " in describe(ANOMALIES[name], anomaly)


def test_a_mirror_may_be_old_but_keeps_the_order_of_commits() -> None:
    writes = [transaction((10 * i, 10 * i + 5), writes={i % 2: i}) for i in range(1, 5)]
    old = [{0: 0, 1: 1}, {0: 2, 1: 1}, {0: 2, 1: 3}]
    late = [transaction((FROM_A_MIRROR, 100 + i), reads, thread=9) for i, reads in enumerate(old)]
    assert find_anomaly(history(*writes, *late)) is None
    for wrong in ({0: 2, 1: 0}, {0: 4, 1: 1}):  # without the commit before
        one = transaction((FROM_A_MIRROR, 110), wrong, thread=8)
        assert find_anomaly(history(*writes, one)) is not None
    early = transaction((FROM_A_MIRROR, 15), {0: 2, 1: 1}, thread=8)
    assert find_anomaly(history(*writes, early)) is not None


def test_a_reading_that_is_many_versions_old() -> None:
    """Gates carry the order over versions that were not read, and around own writes."""
    writes = [transaction((i, 1000), writes={0: i, i % 3 + 1: i}) for i in range(1, 50)]
    late = [transaction((i, 1000), reads={49 % 3 + 1: 49, 0: 3}) for i in (1, 2)]
    for in_order in (True, False):
        assert find_anomaly(history(*writes, in_order=in_order)) is None
        assert find_anomaly(history(*writes, *late, in_order=in_order)) is not None
    own = transaction((0, 1000), reads={0: 3}, writes={0: 60})
    anomaly = find_anomaly(history(*writes, own))
    assert anomaly is not None and len(anomaly.transactions) == 2
    assert find_anomaly(history(*writes, own, in_order=False)) is None


def test_the_simplest_anomaly_is_named() -> None:
    """A cycle without real-time edges is preferred to one with them."""
    anomaly = find_anomaly(
        history(
            transaction((0, 10), writes={0: 1}),
            transaction((20, 30), reads={0: 0}),
            transaction((40, 90), writes={2: 1, 3: 1}),
            transaction((40, 90), reads={2: 1, 3: 0}),
        )
    )
    assert anomaly is not None
    assert anomaly.name == "G-single read skew"
    assert sorted(anomaly.transactions) == [2, 3]


def test_liveliness_counts_what_could_have_gone_wrong() -> None:
    counted = liveliness(
        history(
            transaction((0, 10), writes={0: 1}),
            transaction((5, 15), reads={0: 0}),  # while the next version is written
            transaction((8, 15), reads={0: 1}),  # while the version is written
            transaction((20, 30), reads={0: 1}),
            transaction((22, 28), reads={0: 1}, writes={0: 2}, outcome=CONFLICT),
        )
    )
    assert counted == (1, 1, 2)
