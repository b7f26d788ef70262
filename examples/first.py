"""Set two links at one instant, and look up the pose through both."""

import time

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

with TransformClient.connect("tcp/127.0.0.1:7447") as tf:
    stamp_ns = time.time_ns()
    X_map_base = Transform(translation=(2.0, 1.0, 0.0))
    X_base_camera = Transform(translation=(0.2, 0.0, 0.5))
    tf.set_transforms_xact(
        [
            StampedTransform("map", "base_link", stamp_ns, X_map_base),
            StampedTransform("base_link", "camera", stamp_ns, X_base_camera),
        ]
    )
    X_map_camera = tf.lookup_transform("map", "camera", stamp_ns).transform
    print("one metre ahead of the camera:", X_map_camera.apply([1.0, 0.0, 0.0]))
