"""The checker against the definition, on small histories with all their permutations."""

from __future__ import annotations

import random
from itertools import permutations

from .by_hand import Versions, Written, history, transaction
from .checker import find_anomaly
from .history import COMMITTED, CONFLICT, FROM_A_MIRROR

LINKS = 2
Threads = dict[int | None, list[Written]]


def is_possible(order: tuple[Written, ...], threads: Threads, in_order: bool) -> bool:
    """True if each transaction, run in this order, reads the newest versions of that moment."""
    latest_call_ns = 0
    newest: Versions = {}
    done: list[Written] = []
    for one in order:
        done.append(one)
        if one.invoked_ns == FROM_A_MIRROR:
            of_thread = threads[one.thread]
            place = next(i for i, other in enumerate(of_thread) if other is one)
            if place > 0 and not any(other is of_thread[place - 1] for other in done):
                return False
        if one.responded_ns < latest_call_ns:
            return False
        latest_call_ns = max(latest_call_ns, one.invoked_ns)
        if any(newest.get(link, 0) != stamp for link, stamp in one.reads.items()):
            return False
        if one.outcome != COMMITTED:
            continue
        for link, stamp in one.writes.items():
            if in_order and newest.get(link, 0) > stamp:
                return False
            newest[link] = max(newest.get(link, 0), stamp)
    return True


def some_transactions(rng: random.Random) -> list[Written]:
    """Transactions of a serial run with a few random changes, so that about half are anomalies."""
    n = rng.randint(2, 5)
    stamps = list(range(1, n + 1))
    if rng.random() < 0.5:
        rng.shuffle(stamps)
    newest: Versions = {}
    before: Versions = {}
    found: list[Written] = []
    for index, stamp in enumerate(stamps):
        reads = {
            link: newest.get(link, 0) for link in rng.sample(range(LINKS), rng.randint(0, LINKS))
        }
        for link in reads:
            if rng.random() < 0.15:
                reads[link] = rng.choice([0, *stamps])
        writes = rng.sample(range(LINKS), rng.randint(0, LINKS))
        outcome = CONFLICT if rng.random() < 0.1 else COMMITTED
        called_ns = 4 * index - rng.randint(0, 8)
        thread = None
        if rng.random() < 0.4:
            thread = -rng.randint(1, 2)
            if rng.random() < 0.7:
                writes, called_ns = [], FROM_A_MIRROR
                if found and rng.random() < 0.5:  # the state before the last transaction
                    reads = {link: before.get(link, 0) for link in reads}
        when = (called_ns, 4 * index + rng.randint(0, 8))
        found.append(transaction(when, reads, dict.fromkeys(writes, stamp), outcome, thread))
        before = dict(newest)
        if outcome == COMMITTED:
            newest.update({link: max(newest.get(link, 0), stamp) for link in writes})
    return found


def test_no_anomaly_is_found_where_an_order_is_possible_and_one_where_none_is() -> None:
    rng = random.Random(1)
    orders = {True: 0, False: 0}
    for _ in range(1500):
        transactions = some_transactions(rng)
        in_order = rng.random() < 0.5
        threads: Threads = {}
        for one in transactions:
            threads.setdefault(one.thread, []).append(one)
        possible = any(
            is_possible(order, threads, in_order) for order in permutations(transactions)
        )
        anomaly = find_anomaly(history(*transactions, in_order=in_order))
        assert (anomaly is None) == possible, (in_order, transactions, anomaly)
        orders[possible] += 1
    assert min(orders.values()) > 300, orders
