"""A frame that a transaction found unknown was unknown at the instant of its other answers."""

import contextlib
import threading

import numpy as np

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import OP_LATEST_XACT

ROUNDS = 60
#: Names between the new frame's and the other's: so many that a commit mostly falls among them.
MANY = 20_000


def test_an_unknown_frame_is_unknown_at_the_instant_of_the_other_answers() -> None:
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "known", 1, Transform()))
    pair = np.array([OP_LATEST_XACT] * 2, np.uint8)
    ask, commit = threading.Barrier(2), threading.Barrier(2)

    def write() -> None:
        for stamp_ns in range(2, ROUNDS + 2):
            ask.wait()
            # Releases the GIL, so it runs beside the reader, which keeps it.
            tree.set_transforms_xact(
                [
                    StampedTransform("map", f"new_{stamp_ns}", stamp_ns, Transform()),
                    StampedTransform("map", "known", stamp_ns, Transform()),
                ]
            )
            commit.wait()

    def write_until_aborted() -> None:
        with contextlib.suppress(threading.BrokenBarrierError):
            write()

    writer = threading.Thread(target=write_until_aborted)
    writer.start()
    before = 0
    try:
        for stamp_ns in range(2, ROUNDS + 2):
            names = [f"new_{stamp_ns}", *["map"] * MANY, "known"]
            ask.wait()
            for _ in range(4):
                status, stamps_ns, *_ = tree._read_rows(
                    names,
                    pair,
                    target=np.array([1, 1], np.uint32),
                    source=np.array([0, MANY + 1], np.uint32),
                    stamp_ns=np.zeros(2, np.int64),
                    atomic=True,
                )
                assert status[1] == 0
                seen = stamps_ns[1] == stamp_ns
                assert seen == (status[0] == 0), f"round {stamp_ns}: half of the commit"
                before += not seen
            commit.wait()
    finally:
        ask.abort()
        commit.abort()
        writer.join()
    assert before > 0  # else no read ran beside a commit
