"""A client: ask where the camera is, was, and was along the way."""

import argparse

import numpy as np

from zenoh_tf_client import TransformClient

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
args = parser.parse_args()

with TransformClient.connect(args.connect) as tf:
    now = tf.lookup_latest_transform_xact("map", "camera")  # every link's newest sample
    print("now      ", now.transform.translation)

    then = now.newest_stamp_ns - 250_000_000
    print("250 ms ago", tf.lookup_transform("map", "camera", then).transform.translation)

    stamps_ns = np.linspace(then, now.newest_stamp_ns, 1000).astype(np.int64)
    path = tf.lookup_transforms("map", "camera", stamps_ns)  # a thousand in one round trip
    print("went     ", path.translations[-1] - path.translations[0])
