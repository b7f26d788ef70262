"""A process with mirrors does not grow when their server restarts again and again."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform

_FRAMES = 2000
_SAMPLES = 64
_RESTARTS = 20
_ROWS = 32_000  # of one commit

#: Prints its memory in MB for each line that it reads, when the mirrors have a new server's tree.
READER = """
import sys, time
from zenoh_tf.mirrors.free_memory import resident_bytes
from zenoh_tf_client import TransformClient
tf = TransformClient.connect(sys.argv[1], reads="query")
mirrors, known, first = [], set(), None
def is_whole(mirror):
    try:
        count = mirror.frame("f" + sys.argv[2]).samples
        return mirror.synced and mirror.instance not in known and count == int(sys.argv[3])
    except Exception:
        return False
for line in sys.stdin:
    mirrors = mirrors or [tf.mirror(timeout_s=60) for _ in range(10)]
    end = time.monotonic() + 120
    while not all(is_whole(mirror) for mirror in mirrors):
        assert time.monotonic() < end, mirrors
        time.sleep(0.05)
    known.add(mirrors[0].instance)
    if first is None:
        first = resident_bytes()
    end = time.monotonic() + 70  # what the copies before used is given back within a minute
    while resident_bytes() > 1.3 * first and time.monotonic() < end:
        time.sleep(0.1)
    print(resident_bytes() / 1e6, flush=True)
"""


def fill(server: ServerProcess, rows: list[StampedTransform]) -> None:
    with server.connect(timeout_s=60) as tf:  # on a busy machine
        for begin in range(0, len(rows), _ROWS):
            tf.set_transforms_xact(rows[begin : begin + _ROWS])
        wait_until(lambda: tf.frame(f"f{_FRAMES - 1}").samples == _SAMPLES, "all samples")


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_is_given_back_when_copies_are_replaced(start_server: StartServer) -> None:
    rows = [
        StampedTransform("map", f"f{frame}", stamp * 10_000_000, Transform((frame, stamp, 0)))
        for frame in range(_FRAMES)
        for stamp in range(1, _SAMPLES + 1)
    ]
    server = start_server()
    command = [sys.executable, "-c", READER, server.endpoint, str(_FRAMES - 1), str(_SAMPLES)]
    asked = os.environ | {"ZENOH_TF_TRIM_MEMORY": "1"}
    reader = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=asked
    )
    assert reader.stdin is not None and reader.stdout is not None
    with reader:
        sizes: list[float] = []
        for _ in range(_RESTARTS + 1):
            fill(server, rows)
            reader.stdin.write("\n")
            reader.stdin.flush()
            sizes.append(float(reader.stdout.readline()))
            server.kill()
            server = start_server(endpoint=server.endpoint)
        reader.stdin.close()
    assert sizes[0] > 100, sizes  # otherwise this tests nothing
    assert max(sizes) <= 1.3 * sizes[0], sizes
