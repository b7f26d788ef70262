"""A node of ROS 2 that announces where a sensor is mounted: FRAME X Y Z YAW in base_link."""

import contextlib
import math
import sys

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from zenoh_tf_client.tf2.static_transform_broadcaster import StaticTransformBroadcaster


class Mount(Node):
    def __init__(self, frame: str, x: float, y: float, z: float, yaw: float) -> None:
        super().__init__("mount")
        self.broadcaster = StaticTransformBroadcaster(self)
        t = TransformStamped()
        t.header.stamp = self.get_clock().now().to_msg()
        t.header.frame_id = "base_link"
        t.child_frame_id = frame
        t.transform.translation.x = x
        t.transform.translation.y = y
        t.transform.translation.z = z
        t.transform.rotation.z = math.sin(yaw / 2)
        t.transform.rotation.w = math.cos(yaw / 2)
        self.broadcaster.sendTransform(t)


def main() -> None:
    frame, *numbers = sys.argv[1:]
    rclpy.init()
    node = Mount(frame, *map(float, numbers))
    with contextlib.suppress(KeyboardInterrupt):
        rclpy.spin(node)
    node.destroy_node()


if __name__ == "__main__":
    main()
