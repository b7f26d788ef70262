"""rclpy.duration"""


class Duration:
    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        self._nanoseconds = int(seconds * 1e9) + nanoseconds

    @property
    def nanoseconds(self) -> int:
        return self._nanoseconds
