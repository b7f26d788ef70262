"""A node of ROS 2 that adds a frame: a goal that circles one metre round base_link."""

import contextlib
import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from zenoh_tf_client.tf2 import TransformBroadcaster


class Goal(Node):
    def __init__(self) -> None:
        super().__init__("goal")
        self.broadcaster = TransformBroadcaster(self)
        self.timer = self.create_timer(0.05, self.send)

    def send(self) -> None:
        now = self.get_clock().now()
        angle = now.nanoseconds * 1e-9 % (2 * math.pi)
        t = TransformStamped()
        t.header.stamp = now.to_msg()
        t.header.frame_id = "base_link"
        t.child_frame_id = "goal"
        t.transform.translation.x = math.cos(angle)
        t.transform.translation.y = math.sin(angle)
        t.transform.rotation.w = 1.0
        self.broadcaster.sendTransform(t)


def main() -> None:
    rclpy.init()
    node = Goal()
    with contextlib.suppress(KeyboardInterrupt):
        rclpy.spin(node)
    node.destroy_node()


if __name__ == "__main__":
    main()
