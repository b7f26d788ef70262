"""A sensor: publish where the robot is, ten times a second, without waiting for anyone."""

import argparse
import time

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
parser.add_argument("--count", type=int, default=100)
args = parser.parse_args()

with TransformClient.connect(args.connect) as tf:
    sensor = tf.broadcaster("wheels")
    sensor.send_static([StampedTransform("base_link", "camera", 0, Transform((0.2, 0.0, 0.5)))])
    for i in range(args.count):
        pose = Transform(translation=(0.05 * i, 0.0, 0.0))
        sensor.send([StampedTransform("map", "base_link", time.time_ns(), pose)])
        time.sleep(0.1)
