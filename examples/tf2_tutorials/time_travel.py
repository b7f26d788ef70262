"""A node of ROS 2 that looks into the past: how far base_link has moved within one second."""

import contextlib

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node

from zenoh_tf_client.tf2 import Buffer, TransformException, TransformListener


class TimeTraveller(Node):
    def __init__(self) -> None:
        super().__init__("time_traveller")
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.timer = self.create_timer(0.1, self.look_back)

    def look_back(self) -> None:
        now = self.get_clock().now()
        try:
            t = self.tf_buffer.lookup_transform_full(
                target_frame="base_link",
                target_time=now,
                source_frame="base_link",
                source_time=now - Duration(seconds=1.0),
                fixed_frame="odom",
                timeout=Duration(seconds=0.5),
            )
        except TransformException as error:
            self.get_logger().info(f"not yet: {type(error).__name__}")
            return
        p = t.transform.translation
        self.get_logger().info(f"a second ago at x {p.x:.3f} y {p.y:.3f} of where it is now")


def main() -> None:
    rclpy.init()
    node = TimeTraveller()
    with contextlib.suppress(KeyboardInterrupt):
        rclpy.spin(node)
    node.destroy_node()


if __name__ == "__main__":
    main()
