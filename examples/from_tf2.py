"""A tf2_ros script: only the imports and the choice of a server differ."""

import argparse
import time

from zenoh_tf_client.tf2 import (
    Buffer,
    Duration,
    Time,
    TransformBroadcaster,
    TransformListener,
    TransformStamped,
    connect,
)

parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
connect(parser.parse_args().connect)  # or ZENOH_TF_CONNECT in the environment

tf_buffer = Buffer()
tf_listener = TransformListener(tf_buffer)
tf_broadcaster = TransformBroadcaster()

t = TransformStamped()
t.header.stamp = Time(nanoseconds=time.time_ns())
t.header.frame_id = "map"
t.child_frame_id = "base_link"
t.transform.translation.x = 2.0
t.transform.rotation.w = 1.0
tf_broadcaster.sendTransform(t)

t = tf_buffer.lookup_transform("map", "base_link", t.header.stamp, timeout=Duration(seconds=5))
print("base_link at", t.transform.translation)
