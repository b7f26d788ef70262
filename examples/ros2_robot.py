"""An emulated ROS 2 robot: what a node of rmw_zenoh puts on the network, without ROS.

    python examples/ros2_robot.py --connect tcp/127.0.0.1:7447 --namespace robot1

It drives in a circle: `map -> odom -> base_link` on /tf, and a laser and a camera are fixed on
/tf_static. Keys, tokens, attachments and messages are those of rmw_zenoh: the tests use this file
as their robot. It needs eclipse-zenoh only, of any version from 1.5 on.

With --listen it sends nothing, and prints what it hears on /tf.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import struct
import time
import uuid
from collections.abc import Sequence
from typing import Any

import zenoh
import zenoh.ext

TYPE = "tf2_msgs::msg::dds_::TFMessage_"
HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
HUMBLE_HASH = "TypeHashNotSupported"
QOS = {"tf": "1:2:1,100:,:,:,,", "tf_static": "1:1:1,1:,:,:,,"}

#: parent, child, stamp in ns, (x, y, z, qx, qy, qz, qw) of child in parent
Row = tuple[str, str, int, Sequence[float]]


def tf_message(rows: Sequence[Row]) -> bytes:
    """A tf2_msgs/TFMessage in CDR."""
    data = struct.pack("<I", len(rows))
    for parent, child, stamp_ns, pose in rows:
        data += bytes(-len(data) % 4) + struct.pack("<iI", *divmod(stamp_ns, 10**9))
        for name in (parent, child):
            text = name.encode() + b"\0"
            data += bytes(-len(data) % 4) + struct.pack("<I", len(text)) + text
        data += bytes(-len(data) % 8) + struct.pack("<7d", *pose)
    return b"\0\1\0\0" + data


def rows_of(payload: bytes) -> list[Row]:
    """The rows of a tf2_msgs/TFMessage in CDR."""
    (count,), at = struct.unpack_from("<I", payload, 4), 8
    rows: list[Row] = []
    for _ in range(count):
        at += -(at - 4) % 4
        sec, nsec = struct.unpack_from("<iI", payload, at)
        at, names = at + 8, []
        for _ in range(2):
            at += -(at - 4) % 4
            (size,) = struct.unpack_from("<I", payload, at)
            names.append(payload[at + 4 : at + 3 + size].decode())
            at += 4 + size
        at += -(at - 4) % 8
        pose = struct.unpack_from("<7d", payload, at)
        rows.append((names[0], names[1], sec * 10**9 + nsec, pose))
        at += 56
    assert at == len(payload), "bytes behind the last row"
    return rows


def gid_of(token: str) -> bytes:
    """The id that a publisher with this token marks its messages with."""
    try:
        import xxhash  # noqa: PLC0415 - a robot without it has a random id
    except ImportError:
        return uuid.uuid4().bytes
    return bytes(xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little"))


def open_session(endpoint: str, mode: str = "peer", **settings: str) -> zenoh.Session:
    """A session as rmw_zenoh opens it: a peer that knows a router."""
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, value)
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "10000")
    config.insert_json5("scouting/multicast/enabled", "false")
    if mode == "peer":
        config.insert_json5("listen/endpoints", '["tcp/localhost:0"]')
    return zenoh.open(config)


class Publisher:
    """A publisher of a node, with its token."""

    def __init__(self, session: zenoh.Session, node: Node, topic: str, number: int) -> None:
        path = f"{node.namespace}/{topic}" if node.namespace else topic
        self.key = f"{node.domain}/{path}/{TYPE}/{node.hash}"
        mangled = "%" + path.replace("/", "%")
        token = f"{node.prefix}/{number}/MP/{node.name}/{mangled}/{TYPE}/{node.hash}/{QOS[topic]}"
        self.gid = gid_of(token)
        self.number = 0
        self.publisher: Any
        if topic == "tf_static":
            self.publisher = zenoh.ext.declare_advanced_publisher(
                session,
                self.key,
                congestion_control=zenoh.CongestionControl.BLOCK,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                publisher_detection=True,
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=0.5
                ),
            )
        else:
            self.publisher = session.declare_publisher(self.key)
        self.token = session.liveliness().declare_token(token)

    def send(self, payload: bytes) -> None:
        self.number += 1
        attachment = struct.pack("<qqB", self.number, time.time_ns(), 16) + self.gid
        self.publisher.put(payload, attachment=attachment)


class Node:
    """A node that publishes /tf and /tf_static."""

    def __init__(
        self,
        session: zenoh.Session,
        namespace: str = "",
        domain: int = 0,
        node: str = "robot",
        humble: bool = False,
    ) -> None:
        self.namespace, self.domain = namespace, domain
        self.hash = HUMBLE_HASH if humble else HASH
        mangled = f"%{namespace.replace('/', '%')}"
        self.prefix = f"@ros2_lv/{domain}/{session.zid()}/0"
        self.name = f"%/{mangled}/{node}"
        self._token = session.liveliness().declare_token(f"{self.prefix}/0/NN/{self.name}")
        self._tf = Publisher(session, self, "tf", 1)
        self._static = Publisher(session, self, "tf_static", 2)

    def send(self, rows: Sequence[Row]) -> None:
        """Publish on /tf."""
        self._tf.send(tf_message(rows))

    def send_static(self, rows: Sequence[Row]) -> None:
        """Publish on /tf_static: all of the node's links, each time."""
        self._static.send(tf_message(rows))


def drive(session: zenoh.Session, options: argparse.Namespace) -> None:
    node = Node(session, options.namespace, options.domain, humble=options.humble)
    now_ns = time.time_ns()
    node.send_static(
        [
            ("base_link", "laser", now_ns, (0.2, 0, 0.3, 0, 0, 0, 1)),
            ("base_link", "camera", now_ns, (0.1, 0, 0.5, 0, 0, 0, 1)),
        ]
    )
    print("driving; Ctrl-C stops", flush=True)
    began_s = time.monotonic()
    while (elapsed_s := time.monotonic() - began_s) < options.seconds:
        angle = 0.5 * elapsed_s
        half = (angle + math.pi / 2) / 2
        pose = (math.cos(angle), math.sin(angle), 0, 0, 0, math.sin(half), math.cos(half))
        now_ns = time.time_ns()
        start = ("map", "odom", now_ns, (options.at, 0, 0, 0, 0, 0, 1))
        node.send([start, ("odom", "base_link", now_ns, pose)])
        time.sleep(1 / options.rate)


def listen(session: zenoh.Session, options: argparse.Namespace) -> None:
    path = f"{options.namespace}/tf" if options.namespace else "tf"
    key = f"{options.domain}/{path}/{TYPE}/{HUMBLE_HASH if options.humble else HASH}"
    heard: dict[str, Row] = {}

    def hear(sample: zenoh.Sample) -> None:
        for row in rows_of(sample.payload.to_bytes()):
            if row[1] not in heard:
                print(f"{row[0]} -> {row[1]}", flush=True)
            heard[row[1]] = row

    session.declare_subscriber(key, hear)
    time.sleep(min(options.seconds, 1e6))
    print(json.dumps(heard))


def main() -> None:
    parser = argparse.ArgumentParser(description="An emulated ROS 2 robot that drives in a circle.")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", metavar="ENDPOINT")
    parser.add_argument("--namespace", default="", help="such as robot1 (default: none)")
    parser.add_argument("--domain", type=int, default=0, help="the ROS domain (default: 0)")
    parser.add_argument("--humble", action="store_true", help="as ROS 2 Humble does")
    parser.add_argument("--at", type=float, default=0.0, help="x of its start in the map, metres")
    parser.add_argument("--rate", type=float, default=50.0, help="of /tf, in Hz (default: 50)")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after this time")
    parser.add_argument("--listen", action="store_true", help="print what is heard on /tf instead")
    options = parser.parse_args()
    with open_session(options.connect) as session:
        (listen if options.listen else drive)(session, options)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
