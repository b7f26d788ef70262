"""A tf2_ros script: only the imports differ. It needs no server, and can use one."""

import argparse
import time

from zenoh_tf.tf2 import (
    Buffer,
    Duration,
    Time,
    TransformBroadcaster,
    TransformListener,
    TransformStamped,
    connect,
)

parser = argparse.ArgumentParser()
parser.add_argument("--connect", help="a server, such as tcp/127.0.0.1:7447")
if endpoint := parser.parse_args().connect:
    connect(endpoint)  # the same script on the server's tree

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
