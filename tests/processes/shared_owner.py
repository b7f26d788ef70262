"""The owner of a shared tree in a process of its own.

``python shared_owner.py``: hands the region's file descriptor over through the Unix socket that is
its standard input, then commits chains whose x translations sum to zero, and extends its lease,
until it is killed.
"""

from __future__ import annotations

import random
import socket
import threading
import time

from tests.processes import torn
from zenoh_tf import StampedTransform, Transform, TransformTree

RENEW_S, LEASE_S = 0.05, 0.25


def hold_lease(tree: TransformTree) -> None:
    while True:
        tree._begin_lease(LEASE_S)  # no other process owns this tree
        time.sleep(RENEW_S)


def main() -> None:
    tree = TransformTree(cache_time_s=1.0, max_samples_per_frame=64, _shared=True, _instance="one")
    rng = random.Random(1)
    tree.set_transforms_xact(torn.zero_sum(rng, time.time_ns()))
    threading.Thread(target=hold_lease, args=(tree,), daemon=True).start()
    with socket.socket(fileno=0) as peer:
        socket.send_fds(peer, [b"tree"], [tree._region_fd()])
        for n in range(1 << 60):
            tree.set_transforms_xact(torn.zero_sum(rng, time.time_ns()))
            if n % 50 == 0:  # names and rings come and go
                tree.set_transform(StampedTransform("link0", f"passing{n % 7}", n + 1, Transform()))
                tree.remove_frame(f"passing{n % 7}")


if __name__ == "__main__":
    main()
