"""A sensor: publish the robot's pose fifty times a second, without waiting for answers."""

import argparse
import contextlib
import itertools
import time

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
args = parser.parse_args()

with TransformClient.connect(args.connect) as tf, contextlib.suppress(KeyboardInterrupt):
    wheels = tf.broadcaster("wheels")
    X_base_camera = Transform(translation=(0.2, 0.0, 0.5))
    wheels.send_static(StampedTransform("base_link", "camera", 0, X_base_camera))
    for i in itertools.count():
        X_map_base = Transform(translation=(0.01 * i, 0.0, 0.0))
        wheels.send(StampedTransform("map", "base_link", time.time_ns(), X_map_base))
        time.sleep(0.02)
