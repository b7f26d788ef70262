"""What many threads did to one tree: transactions, and the versions that they read and wrote."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Concurrency = Literal["optimistic", "2pl", "giant"]
Column = NDArray[np.int64]

#: A history ends before the driver's stamps do, of which it has 8191.
TRANSACTIONS = 16_000

# Outcomes, as in driver.cpp. What a refused transaction has read is as good as what others read.
COMMITTED, CONFLICT, LATE, NONSENSE = range(4)
OUTCOMES = ("committed", "refused: conflict", "refused: late", "contradicts itself")


class Transaction(NamedTuple):
    thread: int
    invoked_ns: int
    responded_ns: int
    outcome: int


class Access(NamedTuple):
    transaction: int
    is_write: bool
    link: int
    stamp: int  # names the version; 0: what was there before the history


@dataclass(frozen=True)
class History:
    #: Columns as in Transaction.
    transactions: Column
    #: Columns as in Access. A transaction writes all of its links under one stamp of its own.
    accesses: Column
    #: The tree refuses a stamp that is older than a link's newest: versions come in their order.
    #: Else a late write stands behind newer ones from the beginning, and "latest" never shows it.
    in_order: bool


class Run(NamedTuple):
    """The arguments of one run of the driver: enough to run it again."""

    concurrency: Concurrency
    in_order: bool
    seed: int
    threads: int


def runs(concurrency: Concurrency, n: int) -> Iterator[Run]:
    for seed in range(n):
        yield Run(concurrency, in_order=seed % 2 == 0, seed=seed, threads=3 + seed % 6)


def record(driver: Path, run: Run, file: Path) -> History:
    cache_ns = 0 if run.in_order else 64
    arguments = [run.concurrency, cache_ns, run.seed, run.threads, TRANSACTIONS, file]
    subprocess.run([driver, *map(str, arguments)], check=True, timeout=60)
    return load(file, run.in_order)


def load(file: Path, in_order: bool) -> History:
    words = np.fromfile(file, dtype=np.int64)
    split = 2 + 4 * int(words[0])
    assert words.size == split + 4 * words[1], "the driver was cut off"
    return History(words[2:split].reshape(-1, 4), words[split:].reshape(-1, 4), in_order)


class Liveliness(NamedTuple):
    """How much a history could have shown."""

    committed: int  # transactions that wrote
    conflicts: int  # transactions that were refused, as what they had read was overwritten
    contended: int  # readings while the version that was seen, or the next one, was being written

    def __add__(self, other: tuple[int, ...]) -> Liveliness:  # type: ignore[override]
        return Liveliness(*(a + b for a, b in zip(self, other, strict=True)))


def liveliness(history: History) -> Liveliness:
    _, invoked, responded, outcome = history.transactions.T
    transaction, is_write, link, stamp = history.accesses.T
    wrote = (is_write == 1) & (outcome[transaction] == COMMITTED)
    contended = np.zeros(len(invoked), dtype=bool)
    for one in np.unique(link):
        writes = wrote & (link == one)
        order = np.argsort(stamp[writes])
        stamps, writers = stamp[writes][order], transaction[writes][order]
        reads = (is_write == 0) & (link == one)
        readers = transaction[reads]
        next_one = np.searchsorted(stamps, stamp[reads], side="right")
        for neighbour in (next_one - 1, next_one):
            known = (neighbour >= 0) & (neighbour < len(writers))
            reader, writer = readers[known], writers[neighbour[known]]
            overlap = (invoked[reader] < responded[writer]) & (invoked[writer] < responded[reader])
            contended[reader[overlap & (reader != writer)]] = True
    return Liveliness(
        committed=len(np.unique(transaction[wrote])),
        conflicts=int(np.count_nonzero(outcome == CONFLICT)),
        contended=int(np.count_nonzero(contended)),
    )
