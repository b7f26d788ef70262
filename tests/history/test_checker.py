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


def test_a_mirror_shows_what_its_thread_has_written_and_waited_for() -> None:
    own = transaction((10, 20), writes={0: 1}, thread=9)
    for seen in (0, 1):
        read = transaction((FROM_A_MIRROR, 30), reads={0: seen}, thread=9)
        assert (find_anomaly(history(own, read)) is None) == (seen == 1)


def test_two_readers_that_see_two_writes_in_opposite_orders() -> None:
    anomaly = find_anomaly(
        history(
            transaction(TOGETHER, writes={0: 1}),
            transaction(TOGETHER, writes={1: 2}),
            transaction(TOGETHER, reads={0: 1, 1: 0}),
            transaction(TOGETHER, reads={0: 0, 1: 2}),
        )
    )
    assert anomaly is not None
    assert anomaly.name == "G2 write skew"
    assert sorted(anomaly.transactions) == [0, 1, 2, 3]


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


@pytest.mark.parametrize("in_order", [True, False])
def test_a_serializable_history_has_no_anomaly(in_order: bool) -> None:
    assert (
        find_anomaly(
            history(
                transaction((0, 10), writes={0: 1, 1: 1}),
                transaction((5, 50), reads={0: 0, 1: 0}),  # before the first, which it overlaps
                transaction((12, 40), reads={0: 1}, writes={0: 3}),
                transaction((15, 35), reads={0: 3, 1: 1}),  # before the other has its answer
                transaction((15, 80), reads={0: 1}, writes={1: 2}, outcome=CONFLICT),
                transaction((41, 60), reads={0: 3, 1: 1}),
                transaction((41, 60), writes={1: 4}),
                transaction((61, 70), reads={0: 3, 1: 4}),
                in_order=in_order,
            )
        )
        is None
    )


def test_a_call_at_the_instant_of_a_response_is_not_ordered_after_it() -> None:
    assert (
        find_anomaly(
            history(transaction((0, 10), writes={0: 1}), transaction((10, 20), reads={0: 0}))
        )
        is None
    )


def test_a_late_write_is_an_anomaly_only_if_it_should_have_been_rejected() -> None:
    """T1 writes an older stamp after T2 read T0's newer version: legal if late rows are stored."""
    late = (
        transaction((0, 60), writes={0: 6}),
        transaction((0, 90), writes={0: 5, 1: 5}),
        transaction((0, 80), reads={0: 6, 1: 0}),
    )
    assert find_anomaly(history(*late, in_order=False)) is None
    anomaly = find_anomaly(history(*late, in_order=True))
    assert anomaly is not None
    assert sorted(anomaly.transactions) == [0, 1, 2]


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
