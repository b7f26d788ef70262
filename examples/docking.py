"""Dock with an error of at most 3 cm, or stand still. The robot and its localiser are simulated.

The localiser says every 50 ms where the robot was 80 ms ago, and nothing for a second on the way.
The robot moves only as long as its pose now is known well enough.
"""

import argparse
import threading
import time
from collections import deque

from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf_client import TransformClient

MAX_ERROR_M = 0.03
MAX_SPEED_M_S = 0.15
DOCKED_M = 0.01
STEP_S = 0.05


class Robot:
    """A robot 0.6 m in front of the dock, and its localiser."""

    def __init__(self, tf: TransformClient) -> None:
        self.speed_m_s = 0.0
        self.ended = threading.Event()
        self._tf = tf
        self._x_m = -0.6

    def run(self) -> None:
        silent_s = 1.0
        late: deque[StampedTransform] = deque()
        moved_ns = time.time_ns()
        while not self.ended.wait(0.01):
            now_ns = time.time_ns()
            self._x_m += self.speed_m_s * (now_ns - moved_ns) * 1e-9
            moved_ns = now_ns
            pose = Transform(translation=(self._x_m, 0.0, 0.0))
            late.append(StampedTransform("dock", "base_link", now_ns, pose))
            if self._x_m > -0.3 and silent_s > 0:
                silent_s -= 0.01  # a glare, perhaps
                late.clear()
            elif now_ns - late[0].stamp_ns > 80_000_000:
                self._tf.set_transform(late[0], authority="localiser")
                while late and now_ns - late[0].stamp_ns > 30_000_000:
                    late.popleft()


parser = argparse.ArgumentParser()
parser.add_argument("--connect", default="tcp/127.0.0.1:7447")

with TransformClient.connect(parser.parse_args().connect) as tf:
    robot = Robot(tf)
    localiser = threading.Thread(target=robot.run)
    localiser.start()
    moved = stood = 0
    reason = ""
    try:
        while True:
            try:
                found = tf.estimate_transform("dock", "base_link", max_error_m=MAX_ERROR_M)
            except TransformException as error:  # uncertain, no link, or no server
                robot.speed_m_s, stood = 0.0, stood + 1
                if type(error).__name__ != reason:
                    reason = type(error).__name__
                    print(f"stands still: {reason}: {error}")
            else:
                left_m = -found.transform.translation[0]
                if left_m < DOCKED_M:
                    break
                robot.speed_m_s, moved = min(MAX_SPEED_M_S, left_m), moved + 1
                reason = ""
            time.sleep(STEP_S)
    finally:
        robot.ended.set()
        localiser.join()
    print(f"docked at {1e3 * left_m:.0f} mm, within {1e3 * found.error_m:.0f} mm")
    print(f"moved in {moved} steps, stood still in {stood}")
