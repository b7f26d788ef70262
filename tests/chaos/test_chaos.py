"""Remote transactions under faults are strictly serializable; faulty servers are found.

``CHAOS`` sets the number of transactions; without it a run is short. ``SEED`` repeats
the plan of a run.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.history.checker import describe, find_anomaly
from tests.history.history import COMMITTED, History, Liveliness, liveliness
from tests.support.runs import seed

from .faults import FAULTS, Fault, faulty_server, faulty_text
from .merge import Merged
from .run import READ_KINDS, Chaos

LONG = int(os.environ.get("CHAOS", "0"))
SEED = seed(LONG)
SHORT = 1000
#: A faulty server is given so many runs of so many transactions.
FAULTY_RUNS, FAULTY = 12, 3000
CLIENTS = 8
SOUND_SERVER = [sys.executable, "-m", "zenoh_tf_server"]
#: The kinds of faults that a run must have seen, of all that run.py has.
KINDS = 15

pytestmark = pytest.mark.timeout(600 + LONG // 10)


def proves_something(seen: Liveliness, transactions: int) -> bool:
    """True if enough was committed and overlapped. The bounds are far below what was seen."""
    return (
        seen.committed >= 0.1 * transactions
        and seen.conflicts >= 0.002 * transactions
        and seen.contended >= 0.005 * transactions
    )


def anomaly_in(merged: Merged) -> str | None:
    if merged.complaints:
        return merged.complaints[0]
    anomaly = find_anomaly(merged.history)
    return describe(merged.history, anomaly) if anomaly else None


@pytest.mark.slow
def test_transactions_under_faults_are_strictly_serializable(tmp_path: Path) -> None:
    print(f"\nSEED={SEED}")
    chaos = Chaos(tmp_path, SEED, SOUND_SERVER, CLIENTS)
    merged = chaos.run(LONG) if LONG else chaos.run(SHORT, pause_s=0.1)
    seen = liveliness(merged.history)
    answered = merged.outcomes.get("committed", 0) + merged.outcomes.get("conflict", 0)
    print(f"{answered} transactions: {merged.outcomes}; {merged.kinds}; {seen}")
    print(f"faults: {dict(chaos.faults)}")
    found = anomaly_in(merged)
    assert found is None, f"SEED={SEED}\n{found}"
    assert answered >= (LONG or SHORT)
    assert proves_something(seen, answered), (seen, merged.outcomes)
    assert len(chaos.faults) == KINDS, chaos.faults
    least = LONG // 200 or 1  # a short run may have few of the slower clients
    assert all(merged.kinds.get(kind, 0) >= least for kind in READ_KINDS), merged.kinds


def test_a_history_of_one_client_proves_nothing() -> None:
    history = History(
        np.array([[0, 10 * i, 10 * i + 5, COMMITTED] for i in range(100)]),
        np.array([[i, 1, 0, i + 1] for i in range(100)] + [[i, 0, 1, 0] for i in range(100)]),
        in_order=False,
    )
    assert find_anomaly(history) is None
    assert not proves_something(liveliness(history), 100)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_still_fits_the_server(fault: Fault) -> None:
    """The replaced text occurs once, so that each fault applies even when it is not run here."""
    assert faulty_text(fault)


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_faulty_server_is_found(fault: Fault, tmp_path: Path) -> None:
    command = faulty_server(fault, tmp_path / "server")
    for run in range(FAULTY_RUNS):
        folder = tmp_path / f"run-{run}"
        folder.mkdir()
        merged = Chaos(folder, run, command, CLIENTS, fault.under).run(FAULTY, pause_s=0.1)
        if found := anomaly_in(merged):
            print(f"\nrun {run}: {found}")
            return
    pytest.fail(f"not found in {FAULTY_RUNS} runs")
