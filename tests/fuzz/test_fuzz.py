"""Damaged and made-up input: typed errors, and no crash, hang, growth or unbounded log.

``FUZZ`` sets the number of messages through real Zenoh; `make fuzz` also fuzzes by coverage.
``SEED`` repeats a run.
"""

from __future__ import annotations

import os
import sys

import pytest

from tests.attack.processes import Server
from tests.support.runs import seed

from .corpus import first_inputs, kept, mutated
from .network import play
from .targets import TARGETS

LONG = int(os.environ.get("FUZZ", "0"))
MESSAGES = LONG or 3000
SEED = seed(LONG)
#: Bounds on the log: at most one line per source and period, and each is cut.
LONGEST_LINE = 4000
LOG_BYTES = 2_000_000
#: How much memory may grow over the second half of a run.
GROWTH_MB = 20.0

pytestmark = pytest.mark.timeout(120 + LONG // 100)


@pytest.mark.parametrize("name", TARGETS)
def test_the_corpus_breaks_nothing(name: str) -> None:
    for data in [*first_inputs(name), *kept(name)]:
        TARGETS[name](data)


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_input_breaks_nothing(name: str) -> None:
    print(f"\nSEED={SEED}")
    for data in mutated(name, max(2000, LONG // 20), SEED):
        try:
            TARGETS[name](data)
        except BaseException:
            print(f"input: {data!r}")
            raise


def test_damaged_messages_through_zenoh_break_nothing() -> None:
    print(f"\nSEED={SEED}")
    flags = ("--limit", "waiters=200", "--limit", "frames=5000", "--limit", "outcomes=5000")
    with Server(sys.executable, *flags) as server:
        report = play(server, MESSAGES, SEED)
        print(report)
        status, _ = server.terminate()
    assert status == 0
    bad = [kind for kind in report.outcomes if "cannot be read" in kind or kind == "no reply"]
    assert not bad, report.outcomes
    assert report.outcomes["time-out"] == 0, report.outcomes
    assert report.outcomes["ServiceException"] == 0, "the server took a message for its own fault"
    assert report.outcomes["ok"] > MESSAGES / 50, "hardly any message was valid: this proves little"
    assert report.raw_in_log == 0
    assert report.longest_line < LONGEST_LINE
    assert report.log_bytes < LOG_BYTES
    half = len(report.rss_mb) // 2
    assert report.rss_mb[-1] - report.rss_mb[half] < GROWTH_MB, report.rss_mb
