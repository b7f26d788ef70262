"""Daemon threads inside the native tree while the interpreter shuts down."""

import subprocess
import sys

DAEMONS = """
import threading, time
import numpy as np
from zenoh_tf import StampedTransform, Transform, TransformTree

tree = TransformTree()
many = [StampedTransform("a", "b", stamp, Transform()) for stamp in range(1000)]
tree.set_transforms_xact(many)
stamps, points = np.arange(1000).repeat(20), np.zeros((20_000, 3))
started = threading.Barrier(5)

def repeat(call):
    started.wait()
    while True:
        call()

for call in (
    lambda: tree.sample("a", "b", stamps),
    lambda: Transform().apply(points),
    lambda: tree.set_transforms_xact(many),
    tree.clear,
):
    threading.Thread(target=repeat, args=(call,), daemon=True).start()
started.wait()
time.sleep(0.05)
"""


def test_daemon_threads_inside_the_tree_do_not_abort_the_process_at_exit() -> None:
    """They take the GIL back while the interpreter shuts down, which ends them."""
    for _ in range(3):
        subprocess.run([sys.executable, "-c", DAEMONS], check=True, timeout=150)
