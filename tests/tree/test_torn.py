"""No transactional lookup ever mixes two transactions; two lookups do.

``ZTF_TORN_SECONDS`` sets how long each case runs.
"""

import json
import os
import random
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes import forks, torn
from tests.support.runs import FRAME_LOCKS

SECONDS = float(os.environ.get("ZTF_TORN_SECONDS", "3"))
TRANSACTIONAL = ["lookup_latest_transform_xact", "lookup_transform"]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(60 + 4 * SECONDS)]


def counted(seen: Counter[tuple[str, bool]], was_torn: bool) -> int:
    return sum(n for (_, is_torn), n in seen.items() if is_torn == was_torn)


def check(commits: list[int], seen: list[Counter[tuple[str, bool]]]) -> None:
    """Nothing torn, and enough traffic on both sides that this means something."""
    print(f"{commits=} {seen=}")
    assert all(counted(s, was_torn=True) == 0 for s in seen)
    assert min(commits) > 20 * SECONDS
    assert all(n > 20 * SECONDS for s in seen for n in s.values())
    assert all(len(s) == len(TRANSACTIONAL) for s in seen)


def in_processes(
    endpoint: str, lookups: list[str]
) -> tuple[list[int], list[Counter[tuple[str, bool]]]]:
    def start(role: str, what: str) -> subprocess.Popen[str]:
        command = [sys.executable, str(Path(torn.__file__)), role, endpoint, str(SECONDS), what]
        return forks.Popen(command, stdout=subprocess.PIPE)

    writers = [start("write", str(seed)) for seed in (1, 2)]
    readers = [start("read", ",".join(lookups)) for _ in range(2)]
    outputs = []
    for process in (*writers, *readers):
        output, _ = process.communicate(timeout=30 + 2 * SECONDS)
        assert process.returncode == 0
        outputs.append(json.loads(output))
    seen = [Counter({(name, bool(t)): n for name, t, n in rows}) for rows in outputs[2:]]
    return outputs[:2], seen


@pytest.mark.parametrize("concurrency", FRAME_LOCKS)
def test_processes(start_server: StartServer, concurrency: str) -> None:
    server = start_server("--concurrency", concurrency)
    with server.connect() as tf:
        tf.set_transforms_xact(torn.zero_sum(random.Random(0), time.time_ns()))
    check(*in_processes(server.endpoint, TRANSACTIONAL))
    _, seen = in_processes(server.endpoint, [torn.HALVES])
    assert any(counted(s, was_torn=True) for s in seen), "this test cannot see torn answers"
