"""A transaction: read, decide, and move gripper and object together, or not at all."""

import argparse
import time

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
args = parser.parse_args()
