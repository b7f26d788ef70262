"""A client: look up where the camera is, where it was, and its path in between."""

import argparse

import numpy as np

from zenoh_tf_client import TransformClient

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
args = parser.parse_args()

with TransformClient.connect(args.connect) as tf:
    now = tf.lookup_latest_transform_xact("map", "camera")  # the newest sample of every link
    print("now:", now.transform.translation)

    then_ns = now.newest_stamp_ns - 250_000_000
    then = tf.lookup_transform("map", "camera", then_ns)  # interpolated
    print("a quarter of a second before:", then.transform.translation)

    stamps_ns = then_ns + 250_000 * np.arange(1001)
    path = tf.sample("map", "camera", stamps_ns)  # 1001 lookups, one round trip
    path.raise_for_status()  # a failed lookup raises its error here
    print("moved:", path.translations[-1] - path.translations[0])
