"""Histories of the core, built with yields at critical points, are strictly serializable.

``ANOMALIES`` sets the number of transactions over all modes.
"""

import os
import sys
from dataclasses import replace
from math import ceil
from pathlib import Path

import pytest

from .builds import build_driver
from .checker import describe, find_anomaly
from .history import (
    TRANSACTIONS,
    Concurrency,
    Liveliness,
    Reads,
    Run,
    liveliness,
    record,
    runs,
)

MODES: tuple[Concurrency, ...] = ("optimistic", "2pl", "giant")
HISTORIES = ceil(int(os.environ.get("ANOMALIES", "48000")) / TRANSACTIONS / len(MODES))

pytestmark = pytest.mark.timeout(400 + 10 * HISTORIES)


def proves_something(seen: Liveliness, histories: int) -> bool:
    """True if there was contention. On two busy cores a tenth of the usual has been seen."""
    transactions = histories * TRANSACTIONS
    return (
        seen.committed >= 0.1 * transactions
        and seen.conflicts >= 0.0005 * transactions
        and seen.contended >= 0.001 * transactions
    )


@pytest.fixture(scope="module")
def driver() -> Path:
    return build_driver()


NEEDS_MEMFD = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")


@pytest.mark.parametrize(
    "reads", ["tree", pytest.param("shared", marks=NEEDS_MEMFD), "mirror", "c"]
)
@pytest.mark.parametrize(
    "concurrency",
    [MODES[0], *(pytest.param(mode, marks=pytest.mark.slow) for mode in MODES[1:])],
)
def test_histories_are_strictly_serializable(
    driver: Path, concurrency: Concurrency, reads: Reads, tmp_path: Path
) -> None:
    seen = Liveliness(0, 0, 0)
    for run in runs(concurrency, HISTORIES):
        history = record(driver, run._replace(reads=reads), tmp_path / "history")
        anomaly = find_anomaly(history)
        assert anomaly is None, f"{run}\n{describe(history, anomaly)}"
        seen += liveliness(history)
    print(f"\n{HISTORIES * TRANSACTIONS} transactions, {concurrency}, {reads}: {seen}")
    assert proves_something(seen, HISTORIES), seen


def test_a_history_of_one_thread_proves_nothing(driver: Path, tmp_path: Path) -> None:
    history = record(driver, Run("optimistic", True, seed=1, threads=1), tmp_path / "history")
    assert find_anomaly(history) is None
    assert not proves_something(liveliness(history), 1)


def test_a_wrong_claim_about_the_order_of_versions_is_found(driver: Path, tmp_path: Path) -> None:
    """Late rows are stored here, so a checker that assumes stamp order must find an anomaly."""
    history = record(driver, Run("optimistic", False, seed=1, threads=6), tmp_path / "history")
    assert find_anomaly(history) is None
    assert find_anomaly(replace(history, in_order=True)) is not None
