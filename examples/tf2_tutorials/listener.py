"""A node of ROS 2 that follows the frame goal: it prints the distance and the bearing."""

import contextlib
import math

import rclpy
from rclpy.node import Node

from zenoh_tf_client.tf2 import TransformException
from zenoh_tf_client.tf2.buffer import Buffer
from zenoh_tf_client.tf2.transform_listener import TransformListener


class Follower(Node):
    def __init__(self) -> None:
        super().__init__("follower")
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.timer = self.create_timer(0.1, self.follow)

    def follow(self) -> None:
        try:
            t = self.tf_buffer.lookup_transform("base_link", "goal", rclpy.time.Time())
        except TransformException as error:
            self.get_logger().info(f"no goal yet: {type(error).__name__}")
            return
        p = t.transform.translation
        distance, bearing = math.hypot(p.x, p.y), math.atan2(p.y, p.x)
        self.get_logger().info(f"goal at {distance:.3f} m, {math.degrees(bearing):.1f} deg")


def main() -> None:
    rclpy.init()
    node = Follower()
    with contextlib.suppress(KeyboardInterrupt):
        rclpy.spin(node)
    node.destroy_node()


if __name__ == "__main__":
    main()
