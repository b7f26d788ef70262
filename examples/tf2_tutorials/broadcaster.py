"""A node of ROS 2 that drives base_link round a circle in the frame odom, once in ten seconds."""

import contextlib
import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from zenoh_tf_client.tf2 import TransformBroadcaster


class Odometry(Node):
    def __init__(self) -> None:
        super().__init__("odometry")
        self.broadcaster = TransformBroadcaster(self)
        self.timer = self.create_timer(0.05, self.send)

    def send(self) -> None:
        now = self.get_clock().now()
        heading = 2 * math.pi * (now.nanoseconds * 1e-9 % 10.0) / 10.0
        t = TransformStamped()
        t.header.stamp = now.to_msg()
        t.header.frame_id = "odom"
        t.child_frame_id = "base_link"
        t.transform.translation.x = 2.0 * math.sin(heading)
        t.transform.translation.y = -2.0 * math.cos(heading)
        t.transform.rotation.z = math.sin(heading / 2)
        t.transform.rotation.w = math.cos(heading / 2)
        self.broadcaster.sendTransform(t)


def main() -> None:
    rclpy.init()
    node = Odometry()
    with contextlib.suppress(KeyboardInterrupt):
        rclpy.spin(node)
    node.destroy_node()


if __name__ == "__main__":
    main()
