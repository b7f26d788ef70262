"""The demo of ROS 2: two emulated robots join by one flag, in under 20 seconds.

    python examples/demo_ros2.py

The robots are processes that put on the network what nodes of rmw_zenoh put there, without ROS
(ros2_robot.py). Their frames have the same names.
"""

from __future__ import annotations

import time

from demo_robot import page
from demo_robot.processes import Child, ChildFailed, Children, run_demo
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

ROBOTS = ("robot1", "robot2")
#: How far apart the circles of the robots are, in metres.
APART = 4.0


def _run(children: Children) -> None:
    flags = ("--ros2", "--ros2-prefix", "namespace", "--ros2-shared", "map", "--ros2-publish")
    _, endpoint, client = children.start_server(*flags)
    with client as tf:
        robots = [
            children.start(
                *("ros2_robot", "--connect", endpoint, "--namespace", name),
                *("--at", str(APART * number)),
            )
            for number, name in enumerate(ROBOTS)
        ]
        print()
        page.heading("Two ROS 2 robots, and nothing but a flag")
        page.prose(
            f"""zenoh-tf-server {" ".join(flags)} listens on {endpoint}. Two robots connect to it
            as nodes of rmw_zenoh do. Both call their frames odom, base_link, laser and camera; the
            map is the same for both."""
        )
        _wait(tf, robots)
        _frames(tf)
        _lookup(tf)
        _out(tf, children, endpoint)


def _wait(tf: TransformClient, robots: list[Child]) -> None:
    """Wait until both robots have published for a second."""
    since_ns = time.time_ns() + 1_000_000_000
    for name in ROBOTS:
        while not tf.can_transform("map", f"{name}/camera", since_ns):
            for robot in robots:
                robot.check()
            if time.time_ns() > since_ns + 30_000_000_000:
                raise ChildFailed("the robots' data did not arrive within 30 s")
            time.sleep(0.05)


def _frames(tf: TransformClient) -> None:
    rows = [("frame", "parent", "static", "published by")]
    for name in sorted(tf.frames()):
        frame = tf.frame(name)
        if frame.parent is not None:
            rows.append((name, frame.parent, "yes" if frame.static else "", frame.authority))
    page.table(rows)


def _lookup(tf: TransformClient) -> None:
    page.heading("One robot seen from the other")
    found = tf.lookup_transform("robot1/laser", "robot2/base_link").transform
    x, y, z = found.translation
    page.prose(
        f"""lookup_transform("robot1/laser", "robot2/base_link") is ({x:.2f}, {y:.2f}, {z:.2f}) m,
        at a time that both robots have data for. Their circles are {APART:g} m apart."""
    )
    rows = [("published by", "messages", "stored", "clock ahead, s", "conflicts")]
    for each in tf.authorities():
        ahead = each.clock_offset_max_s
        rows.append(
            (
                each.name,
                str(each.commits),
                str(each.stored),
                "" if ahead is None else f"{ahead:.4f}",
                str(each.conflicts),
            )
        )
    page.table(rows)


def _out(tf: TransformClient, children: Children, endpoint: str) -> None:
    listener = children.start("ros2_robot", "--connect", endpoint, "--listen", "--seconds", "2")
    for step in range(40):
        goal = Transform((1.0, 0.05 * step, 0.0))
        tf.set_transform(StampedTransform("map", "goal", time.time_ns(), goal), "planner")
        time.sleep(0.05)
    heard = listener.report()
    page.heading("And back")
    page.prose(
        f"""A planner that knows nothing of ROS sets map -> goal 20 times a second. With
        --ros2-publish a ROS 2 node hears on /tf: {", ".join(sorted(heard)) or "nothing"}. The
        robots' own frames are not sent back to them."""
    )
    if sorted(heard) != ["goal"]:
        raise ChildFailed(f"the listener heard {sorted(heard)} instead of goal")


if __name__ == "__main__":
    raise SystemExit(run_demo(_run))
