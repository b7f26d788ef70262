# mypy: ignore-errors
# The packages may be missing, and their types do not fit together.
"""A node of another project's ROS 2 package, in a process of its own.

    python tests/ros2/foreign.py pyzeros|sdk PORT

It publishes on /{package}/tf, as a child {package}_base of {package}_odom, and prints the rows that
it hears on /tf as JSON. Both packages speak to a router of rmw_zenoh.
"""

import asyncio
import json
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

PERIOD_S = 0.05


def heard(message: Any) -> None:
    for row in message.transforms:
        where, stamp = row.transform.translation, row.header.stamp
        found = [row.header.frame_id, row.child_frame_id, stamp.sec * 10**9 + stamp.nanosec]
        print(json.dumps([*found, [where.x, where.y, where.z]]), flush=True)


def with_pyzeros(port: str) -> None:
    import pyzeros  # noqa: PLC0415
    from ros2_pyterfaces.cyclone import all_msgs as msgs  # noqa: PLC0415
    from ros2_pyterfaces.cyclone.idl import IdlStruct, types  # noqa: PLC0415

    from ros2_robot import open_session  # noqa: PLC0415

    # No annotations as text: the package reads them when the class is made.
    @dataclass
    class TFMessage(IdlStruct, typename="tf2_msgs/msg/TFMessage"):
        transforms: types.sequence[msgs.TransformStamped] = field(default_factory=list)

    async def run() -> None:
        import asyncio_for_robotics as afor  # noqa: PLC0415

        async with afor.Scope():
            publisher = pyzeros.Pub(TFMessage, "/pyzeros/tf")
            subscriber = pyzeros.Sub(TFMessage, "/tf")
            publishing = asyncio.ensure_future(publish(publisher))
            async for message in subscriber.listen_reliable():
                heard(message)
                assert not publishing.done()

    async def publish(publisher: Any) -> None:
        while True:
            now = msgs.Time(*divmod(time.time_ns(), 10**9))
            row = msgs.TransformStamped(msgs.Header(now, "pyzeros_odom"), "pyzeros_base")
            row.transform.translation.x, row.transform.rotation.w = 1.0, 1.0
            publisher.publish(TFMessage([row]))
            await asyncio.sleep(PERIOD_S)

    with (
        open_session(f"tcp/127.0.0.1:{port}") as session,
        pyzeros.auto_context(node="pyzeros_node", zenoh_session=session),
    ):
        asyncio.run(run())


def with_sdk(port: str) -> None:
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber  # noqa: PLC0415

    from_rosbags = get_typestore(Stores.ROS2_JAZZY)
    kind = "tf2_msgs/msg/TFMessage"
    definition, _ = from_rosbags.generate_msgdef(kind, ros_version=2)
    hash_ = from_rosbags.hash_rihs01(kind)
    common: dict[str, Any] = {
        "msg_type": kind,
        "msg_definition": definition,
        "type_hash": hash_,
        "router_port": int(port),
    }
    subscriber = ROS2Subscriber(topic="/tf", callback=heard, **common)
    publisher = ROS2Publisher(topic="/sdk/tf", node_name="sdk_node", **common)
    types = publisher.session_mgr.store.types
    while True:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(time.time_ns(), 10**9))
        row = types["geometry_msgs/msg/TransformStamped"](
            types["std_msgs/msg/Header"](stamp, "sdk_odom"),
            "sdk_base",
            types["geometry_msgs/msg/Transform"](
                types["geometry_msgs/msg/Vector3"](1.0, 0.0, 0.0),
                types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            ),
        )
        publisher.publish(transforms=[row])
        time.sleep(PERIOD_S)
        assert subscriber is not None


if __name__ == "__main__":
    {"pyzeros": with_pyzeros, "sdk": with_sdk}[sys.argv[1]](sys.argv[2])
