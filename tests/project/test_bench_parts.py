"""Every part of the benchmark runs: ``python -m bench PART --quick``, as a user does."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bench.__main__ import PARTS
from bench.parts import native
from zenoh_tf_server.limits import Limits

ROOT = Path(__file__).parents[2]


# The first one builds bench_core, once: a minute of processor time.
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("part", PARTS)
def test_a_part_runs(part: str) -> None:
    command = [sys.executable, "-m", "bench", part, "--quick"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert f"\n{part}: " in done.stdout  # it came to its end


def test_quick_runs_have_chains_deeper_than_the_default_limit() -> None:
    assert Limits().depth < native.QUICK_LINKS
