"""Concurrent client processes: no lost update, no torn read."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import pytest

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.servers import ServerProcess
from tests.support import torn
from tests.support.concurrency import CONTROLS
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

COUNTER = """
import json, sys
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

attempts = 0

def add(tx):
    global attempts
    attempts += 1
    x = tx.lookup_latest_transform_xact("map", "counter").transform.translation[0]
    tx.set_transform(StampedTransform("map", "counter", 1, Transform((x + 1, 0, 0))))

with TransformClient.connect(sys.argv[1]) as tf:
    print("ready", flush=True)
    sys.stdin.readline()
    for _ in range(int(sys.argv[2])):
        tf.run_transaction(add, attempts=1000)
print(json.dumps(attempts))
"""


def run_together(code: str, *arguments: tuple[str, ...]) -> list[int]:
    """Run a client process per tuple of arguments, all at once; return what they print."""
    processes = [
        forks.Popen(
            [sys.executable, "-c", code, *args],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        for args in arguments
    ]
    try:
        for process in processes:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
        for process in processes:
            assert process.stdin is not None
            process.stdin.write("go\n")
            process.stdin.flush()
        outputs = [process.communicate(timeout=150)[0] for process in processes]
        assert [process.returncode for process in processes] == [0] * len(processes)
        return [json.loads(output) for output in outputs]
    finally:
        for process in processes:
            process.kill()
            process.communicate()


@pytest.mark.parametrize("concurrency", CONTROLS)
def test_no_update_is_lost(start_server: StartServer, concurrency: str) -> None:
    server = start_server("--concurrency", concurrency)
    with server.connect() as tf:
        tf.set_transform(StampedTransform("map", "counter", 1, Transform()))
        attempts = run_together(COUNTER, *[(server.endpoint, "100")] * 2)
        counted = tf.lookup_latest_transform_xact("map", "counter").transform.translation[0]
        assert counted == 200
        assert sum(attempts) > 200, "no transaction was retried, so the test proves nothing"


def test_a_client_killed_in_a_write_leaves_no_torn_state(
    server: ServerProcess, client: TransformClient
) -> None:
    script = [sys.executable, torn.__file__, "write", server.endpoint, "100", "1"]
    before = client.stats()["commits"]
    process = forks.Popen(script, stdout=subprocess.PIPE)
    while client.stats()["commits"] < before + 20:
        assert process.poll() is None
    process.kill()
    process.communicate()
    answer = client.lookup_latest_transform_xact(torn.ROOT, torn.LEAF)
    assert answer.transform.translation[0] == 0
    link = StampedTransform(torn.ROOT, "link1", time.time_ns(), Transform())
    assert client.set_transform(link)
