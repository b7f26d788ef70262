"""An emulated ROS 2 peer in a process of its own, driven by lines of JSON on its standard input.

    python tests/ros2/peer.py ENDPOINT MODE

Each line is a list: a command and its arguments. The peer answers each with a line, the JSON of the
result. It needs only eclipse-zenoh, of any version from 1.5 on.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import zenoh
import zenoh.ext

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

from ros2_robot import (
    HASH,
    HUMBLE_HASH,
    TYPE,
    Node,
    Publisher,
    open_session,
    rows_of,
    tf_message,
)


class Bridge:
    """zenoh-bridge-ros2dds: keys without domain and type, no attachments."""

    def __init__(self, session: zenoh.Session, namespace: str, history: str) -> None:
        path = f"{namespace}/" if namespace else ""
        self._session = session
        self._tokens = []
        for topic, durability in (("tf", 0), ("tf_static", 1)):
            mangled = f"{path}{topic}".replace("/", "§")
            token = (
                f"@/{session.zid()}/@ros2_lv/MP/{mangled}/tf2_msgs§msg§TFMessage"
                f"/:1:{durability}:0,10"
            )
            self._tokens.append(session.liveliness().declare_token(token))
        self._tf = session.declare_publisher(f"{path}tf")
        self._static: Any
        key = f"{path}tf_static"
        if history == "cache":  # since 1.5.1: it keeps the last ten messages, of all its nodes
            self._static = zenoh.ext.declare_advanced_publisher(
                session, key, cache=zenoh.ext.CacheConfig(max_samples=10), publisher_detection=True
            )
        else:  # before: a queryable, and no token for it
            self._static = session.declare_publisher(key)
            self._kept: list[bytes] = []

            def reply(query: zenoh.Query) -> None:
                with query:
                    for payload in self._kept:
                        query.reply(key, payload)

            self._queryable = session.declare_queryable(
                f"{key}/@ros2_pub_cache/{session.zid()}", reply
            )

    def send(self, rows: Any) -> None:
        self._tf.put(tf_message(rows))

    def send_static(self, rows: Any) -> None:
        payload = tf_message(rows)
        if hasattr(self, "_kept"):
            self._kept.append(payload)
        self._static.put(payload)


class Peer:
    """Runs the commands."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._nodes: dict[str, Any] = {}
        self._kept: list[Any] = []  # what is declared
        self._heard: list[Any] = []
        self._asked = threading.Semaphore(0)

    def node(self, name: str, *arguments: Any) -> str:
        """Make a node of rmw_zenoh; returns the session's id."""
        self._nodes[name] = Node(self._session, *arguments)
        return str(self._session.zid())

    def forget(self, name: str, detected: bool) -> None:
        """Let a node's /tf_static keep nothing, though its token says that it does; `detected`: a
        second token says so, too."""
        static = self._nodes[name]._static
        static.publisher.undeclare()
        if detected:
            static.publisher = zenoh.ext.declare_advanced_publisher(
                self._session, static.key, publisher_detection=True
            )
        else:
            static.publisher = self._session.declare_publisher(static.key)

    def renew(self, name: str, number: int, keep: bool = False) -> None:
        """Give a node another publisher of /tf_static; `keep`: the one before stays, and is
        silent."""
        node = self._nodes[name]
        if keep:
            self._kept.append(node._static)
        else:
            node._static.token.undeclare()
            node._static.publisher.undeclare()
        node._static = Publisher(self._session, node, "tf_static", number)

    def bridge(self, name: str, namespace: str, history: str = "cache") -> None:
        self._nodes[name] = Bridge(self._session, namespace, history)

    def send(self, name: str, rows: Any) -> None:
        self._nodes[name].send(rows)

    def send_static(self, name: str, rows: Any) -> None:
        self._nodes[name].send_static(rows)

    def close_node(self, name: str) -> None:
        del self._nodes[name]

    def reliable(self, name: str) -> None:
        """Let a node's /tf wait where it would drop."""
        tf = self._nodes[name]._tf
        tf.publisher.undeclare()
        tf.publisher = self._session.declare_publisher(
            tf.key, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def burst(self, name: str, messages: int, rows: int) -> None:
        """Send messages of as many rows, as fast as possible; none is dropped here."""
        self.reliable(name)
        node, stamp_ns = self._nodes[name], time.time_ns()
        for number in range(messages):
            stamp = stamp_ns + 1000 * number
            node.send([("map", f"part_{row}", stamp, (1, 2, 3, 0, 0, 0, 1)) for row in range(rows)])

    def put(self, key: str, payload: str, attachment: str | None = None) -> None:
        """Put raw bytes, given in hexadecimal."""
        mark = None if attachment is None else bytes.fromhex(attachment)
        self._session.put(
            key,
            bytes.fromhex(payload),
            attachment=mark,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def token(self, key: str) -> None:
        self._kept.append(self._session.liveliness().declare_token(key))

    def stall(self, path: str) -> None:
        """A publisher of static transforms that never answers."""
        key = f"{path}/{TYPE}/{HASH}/@adv/pub/{self._session.zid()}/7/_"

        def keep(query: zenoh.Query) -> None:
            self._kept.append(query)
            self._asked.release()

        self._kept.append(self._session.declare_queryable(key, keep))
        self.token(key)

    def was_asked(self) -> bool:
        """Wait until the publisher that stalls is asked."""
        return self._asked.acquire(timeout=30)

    def listen(self, topic: str, humble: bool = False, domain: int = 0) -> None:
        """Subscribe as a node of rmw_zenoh does; a late subscriber of statics asks for them."""
        key = f"{domain}/{topic}/{TYPE}/{HUMBLE_HASH if humble else HASH}"
        if topic.endswith("tf_static"):
            subscriber: Any = zenoh.ext.declare_advanced_subscriber(
                self._session,
                key,
                self._hear,
                history=zenoh.ext.HistoryConfig(max_samples=1, detect_late_publishers=True),
                recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
        else:
            subscriber = self._session.declare_subscriber(key, self._hear)
        self._kept.append(subscriber)

    def listen_bridge(self, topic: str) -> None:
        self._kept.append(self._session.declare_subscriber(topic, self._hear))

    def _hear(self, sample: zenoh.Sample) -> None:
        mark = None if sample.attachment is None else sample.attachment.to_bytes().hex()
        self._heard.append([str(sample.key_expr), mark, rows_of(sample.payload.to_bytes())])

    def heard(self) -> list[Any]:
        """What the subscribers have heard: key, attachment and rows of each message."""
        return list(self._heard)

    def tokens(self) -> list[str]:
        """The tokens of all ROS 2 nodes and publishers."""
        replies = self._session.liveliness().get("@ros2_lv/**", timeout=5)
        return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def version(self) -> str:
        from importlib.metadata import version  # noqa: PLC0415

        return version("eclipse-zenoh")


def main() -> None:
    endpoint, mode = sys.argv[1:3]
    if mode == "router":
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        session = zenoh.open(config)
    elif mode == "bridge":
        session = open_session(endpoint, "client", timestamping='{"enabled": true}')
    else:
        session = open_session(endpoint, mode)
    peer = Peer(session)
    print(json.dumps("ready"), flush=True)
    for line in sys.stdin:
        command, *arguments = json.loads(line)
        print(json.dumps(getattr(peer, command)(*arguments)), flush=True)
    os._exit(0)  # to close a session takes seconds while a queryable holds a query


if __name__ == "__main__":
    main()
