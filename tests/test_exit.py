"""Programs that end without closing anything end all the same."""

from __future__ import annotations

import subprocess
import sys

from .conftest import ServerProcess

DAEMONS_THAT_WAIT = """
import threading, time
from zenoh_tf import StampedTransform, Transform, TransformException, TransformTree

tree = TransformTree()
tree.set_transform(StampedTransform("a", "b", 1, Transform()))
waiting = threading.Barrier(5)

def wait(timeout_s):
    waiting.wait()
    while True:
        try:
            tree.lookup_transform("a", "b", 5, timeout_s=timeout_s)
        except TransformException:
            pass

for timeout_s in (0.001, 0.01, 0.05, 100):
    threading.Thread(target=wait, args=(timeout_s,), daemon=True).start()
waiting.wait()
time.sleep(0.05)
"""

NEVER_CLOSED = """
import sys
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

tf = TransformClient.connect(sys.argv[1])
tf.broadcaster("sensor").send_static(StampedTransform("a", "b", 0, Transform()))
assert tf.can_transform("a", "b", timeout_s=10)
"""


def run(script: str, *arguments: str) -> None:
    subprocess.run([sys.executable, "-c", script, *arguments], check=True, timeout=30)


def test_daemon_threads_that_wait_for_a_transform() -> None:
    for _ in range(5):
        run(DAEMONS_THAT_WAIT)


def test_a_client_with_a_broadcaster_that_is_never_closed(server: ServerProcess) -> None:
    for _ in range(3):
        run(NEVER_CLOSED, server.endpoint)
