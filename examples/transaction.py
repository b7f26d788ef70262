"""A transaction: read, decide, and move gripper and object together, or not at all."""

import argparse
import time

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import Transaction, TransformClient

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
args = parser.parse_args()

PAIR = ("gripper", "object")


def lift(tx: Transaction) -> None:
    """Runs again if another writer moves either frame between the lookup and the commit."""
    poses = tx.lookup_latest_transforms_xact([("map", name) for name in PAIR])
    up, now_ns = Transform(translation=(0.0, 0.0, 0.1)), time.time_ns()
    tx.set_transforms_xact(
        [StampedTransform("map", pose.child_frame, now_ns, up @ pose.transform) for pose in poses]
    )


with TransformClient.connect(args.connect) as tf:
    begin_ns = time.time_ns()
    tf.set_transforms_xact([StampedTransform("map", name, begin_ns, Transform()) for name in PAIR])
    for _ in range(3):
        tf.run_transaction(lift)
    print("object at", tf.lookup_latest_transform_xact("map", "object").transform.translation)
