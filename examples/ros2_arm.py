"""An emulated arm: its joint states as a node of rmw_zenoh sends them, without ROS.

    python examples/ros2_arm.py --connect tcp/127.0.0.1:7447 --namespace robot1

It sends sensor_msgs/JointState on the topic joint_states, with the joints of examples/arm.urdf.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import time
import uuid

import numpy as np

from ros2_robot import open_session
from zenoh_tf.ros2 import attachment, keys
from zenoh_tf.ros2.cdr import JointState, encode_joint_state

#: Middle and reach of each joint: radians, metres for the last two.
JOINTS = {
    "pan": (0.0, 3.0),
    "elbow": (0.2, 1.0),
    "roll": (0.0, 2.0),
    "slide": (0.12, 0.1),
    "left": (0.02, 0.02),
}


def main() -> None:
    parser = argparse.ArgumentParser(description="An emulated arm that sends its joint states.")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", metavar="ENDPOINT")
    parser.add_argument("--namespace", default="", help="such as robot1 (default: none)")
    parser.add_argument("--domain", type=int, default=0, help="the ROS domain (default: 0)")
    parser.add_argument("--rate", type=float, default=50.0, help="in Hz (default: 50)")
    options = parser.parse_args()
    topic = keys.Topic("joint_states", options.namespace, options.domain)
    key = keys.rmw_key(topic, keys.JOINT_STATE, keys.JOINT_STATE.hash)
    gid = uuid.uuid4().bytes
    middle, reach = np.transpose(list(JOINTS.values()))
    # A peer that knows a router, as every node of rmw_zenoh is.
    with open_session(options.connect) as session, contextlib.suppress(KeyboardInterrupt):
        publisher = session.declare_publisher(key)
        print(f"moving, on {topic.path}; Ctrl-C stops", flush=True)
        number = 0
        while True:
            number += 1
            now_ns = time.time_ns()
            phase = 2 * math.pi * (now_ns % 8_000_000_000) / 8e9  # once in eight seconds
            state = JointState(list(JOINTS), middle + reach * math.sin(phase), stamp_ns=now_ns)
            sent = attachment.Attachment(number, now_ns, gid)
            publisher.put(encode_joint_state(state), attachment=attachment.encode(sent))
            time.sleep(1 / options.rate)


if __name__ == "__main__":
    main()
