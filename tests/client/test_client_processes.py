"""Concurrent client processes: no lost update, no torn read."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from contextlib import ExitStack

import pytest

from tests.conftest import StartServer
from tests.processes import forks, torn
from tests.processes.line_process import LineProcess
from tests.processes.servers import ServerProcess
from tests.support.runs import CONTROLS
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
    with ExitStack() as running:
        processes = [running.enter_context(LineProcess("-c", code, *each)) for each in arguments]
        for process in processes:
            process.say("go")
        return [json.loads(process.read_line()) for process in processes]


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
