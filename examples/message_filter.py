"""Messages wait for their transforms: no lookup fails, and nothing polls. No ROS is needed."""

import queue
import time

from zenoh_tf import tf2
from zenoh_tf.tf2 import Header, Point, PointStamped, Time

buffer = tf2.Buffer()
listener = tf2.TransformListener(buffer)
lines: queue.SimpleQueue[str] = queue.SimpleQueue()

points = tf2.TransformFilter(None, buffer, "map", 2)  # holds two messages at most
points.registerCallback(lambda p, t: lines.put(f"in map: {tf2.do_transform_point(p, t).point}"))
points.registerFailureCallback(lambda p, reason, error: lines.put(f"{reason.name}: {error}"))

start_ns = time.time_ns()
for number in range(3):  # the sensor is faster than the odometry
    stamp = Time(nanoseconds=start_ns + number * 10**8)
    points.add(PointStamped(Header(stamp, "base_link"), Point(x=float(number))))
print(lines.get())

t = tf2.TransformStamped(Header(Time(), "map"), "base_link")
for number in range(3):  # one metre per second
    t.header.stamp = Time(nanoseconds=start_ns + number * 10**8)
    t.transform.translation.y = number / 10
    tf2.TransformBroadcaster().sendTransform(t)
    if number > 0:
        print(lines.get())
