"""rclpy.callback_groups"""


class ReentrantCallbackGroup:
    pass
