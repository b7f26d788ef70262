"""A history: the transactions of many threads on one tree, and what they read and wrote."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Concurrency = Literal["optimistic", "2pl", "giant"]
#: Where half of the threads read: in the tree, its memory as other processes map it, or a mirror;
#: "c": in the tree, which they read and write by the functions of zenoh_tf.h.
Reads = Literal["tree", "shared", "mirror", "c"]
Column = NDArray[np.int64]

#: The call of a transaction that read a mirror: what it read may be old, so it has no earliest
#: time. It follows the transaction before it of its thread.
FROM_A_MIRROR = int(np.iinfo(np.int64).min)
#: Transactions of one history. The driver has 8191 stamps, which suffice for them.
TRANSACTIONS = 16_000

# Outcomes, as in driver.cpp. Reads of a rejected transaction are checked like all others.
COMMITTED, CONFLICT, LATE, INCONSISTENT, OTHER = range(5)
OUTCOMES = (
    "committed",
    "rejected: conflict",
    "rejected: too old",
    "inconsistent",
    "rejected: no frame, or none left",
)


class Transaction(NamedTuple):
    thread: int
    invoked_ns: int
    responded_ns: int
    outcome: int


class Access(NamedTuple):
    transaction: int
    is_write: bool
    link: int
    stamp: int  # identifies the version; 0: the state before the history


@dataclass(frozen=True)
class History:
    #: Columns as in Transaction.
    transactions: Column
    #: Columns as in Access. A transaction writes all of its links under one stamp of its own.
    accesses: Column
    #: True if the tree rejects stamps older than the newest of a link, so that versions are
    #: written in stamp order. Otherwise a late write is never the latest of its link.
    in_order: bool


class Run(NamedTuple):
    """The arguments of one run of the driver, which repeat it."""

    concurrency: Concurrency
    in_order: bool
    seed: int
    threads: int
    reads: Reads = "tree"


def runs(concurrency: Concurrency, n: int) -> Iterator[Run]:
    for seed in range(n):
        yield Run(concurrency, in_order=seed % 2 == 0, seed=seed, threads=3 + seed % 6)


def record(driver: Path, run: Run, file: Path) -> History:
    cache_ns = 0 if run.in_order else 64
    arguments: list[object] = [run.concurrency, cache_ns, run.seed, run.threads, TRANSACTIONS]
    arguments += [run.reads, file]
    subprocess.run([driver, *map(str, arguments)], check=True, timeout=150)
    return load(file, run.in_order)


def load(file: Path, in_order: bool) -> History:
    words = np.fromfile(file, dtype=np.int64)
    split = 2 + 4 * int(words[0])
    assert words.size == split + 4 * words[1], "the driver was cut off"
    return History(words[2:split].reshape(-1, 4), words[split:].reshape(-1, 4), in_order)


class Liveliness(NamedTuple):
    """How much contention a history had, and so how much it could have shown."""

    committed: int  # transactions that wrote
    conflicts: int  # transactions rejected because what they had read was overwritten
    contended: int  # reads that overlapped the write of the version read, or of the next one

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
            overlap &= invoked[reader] != FROM_A_MIRROR
            contended[reader[overlap & (reader != writer)]] = True
    return Liveliness(
        committed=len(np.unique(transaction[wrote])),
        conflicts=int(np.count_nonzero(outcome == CONFLICT)),
        contended=int(np.count_nonzero(contended)),
    )
