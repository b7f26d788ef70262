"""How ROS 2 names topics and publishers on a Zenoh network. No I/O.

Two kinds of peers speak ROS 2 over Zenoh, and neither understands the other:

    rmw_zenoh            data    0/robot1/tf/tf2_msgs::msg::dds_::TFMessage_/RIHS01_e369...
                         token   @ros2_lv/0/<zid>/<node>/<id>/MP/%/%robot1/nav/%robot1%tf/<type>/...
    zenoh-bridge-ros2dds data    robot1/tf
                         token   @/<zid>/@ros2_lv/MP/robot1§tf/tf2_msgs§msg§TFMessage/...

A publisher that keeps its last messages for late subscribers (`/tf_static`) has one more token,
`<data key>/@adv/pub/<zid>/<id>/_`. A query of that key is answered with the messages.

Thread safety: all functions.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

#: The hash of a type in the key is the same from Iron on; Humble has none, and says so.
NO_HASH: Final = "TypeHashNotSupported"
_MAX_KEY_BYTES: Final = 2000
_MAX_CHUNKS: Final = 32

_RMW_TOKEN: Final = "@ros2_lv"
_BRIDGE_TOKEN: Final = "@"
_HISTORY: Final = "@adv"
#: A part of a ROS name. It begins with no digit, so a number in a key is the domain.
_NAME: Final = re.compile(r"[A-Za-z_~][A-Za-z0-9_~]*")
_DOMAIN: Final = re.compile(r"[0-9]{1,10}")
#: In the part of a token that has the quality of service.
_TRANSIENT_LOCAL: Final = "1"


@dataclass(frozen=True, slots=True)
class MessageType:
    """A ROS 2 message type, with the hash of its definition."""

    package: str
    name: str
    hash: str

    @property
    def chunk(self) -> str:
        """The type in keys of rmw_zenoh."""
        return f"{self.package}::msg::dds_::{self.name}_"

    @property
    def bridge_chunk(self) -> str:
        """The type in tokens of the bridge."""
        return f"{self.package}§msg§{self.name}"


TF_MESSAGE: Final = MessageType(
    "tf2_msgs",
    "TFMessage",
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
)
JOINT_STATE: Final = MessageType(
    "sensor_msgs",
    "JointState",
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
)


@dataclass(frozen=True, slots=True)
class Topic:
    """Where a message was published."""

    name: str  # the last part, "tf"
    namespace: str  # "robot1", or "" at the root; of several parts "fleet/robot1"
    domain: int | None  # None: of a bridge, which does not send it

    @property
    def is_bridged(self) -> bool:
        """True if a bridge to DDS publishes it."""
        return self.domain is None

    @property
    def path(self) -> str:
        """The topic as ROS writes it, e.g. ``/robot1/tf``."""
        return f"/{self.namespace}/{self.name}" if self.namespace else f"/{self.name}"


@dataclass(frozen=True, slots=True)
class TopicPublisher:
    """A publisher as its token describes it."""

    zid: str  # the Zenoh id of its session
    topic: Topic
    node: str | None  # with its namespace, ``/robot1/nav``; None: the bridge, for nodes behind it
    token: str  # whose hash rmw_zenoh sends along with each message
    data: str  # the key of its messages
    is_latched: bool  # it declares to keep messages for late subscribers (transient-local)


def data(topic: str, kind: MessageType) -> tuple[str, str]:
    """The key expressions of a topic in any domain and namespace: of rmw_zenoh, of any version of
    ROS 2, and behind bridges."""
    return f"**/{topic}/{kind.chunk}/*", f"**/{topic}"


def rmw_key(topic: Topic, kind: MessageType, hash_: str) -> str:
    """The key on which a node of rmw_zenoh publishes."""
    return f"{topic.domain}{topic.path}/{kind.chunk}/{hash_}"


def parse_data(key: str, kind: MessageType) -> Topic | None:
    """The topic of a message's key; None if it is not a key of either kind."""
    if len(key) > _MAX_KEY_BYTES or key.count("/") > _MAX_CHUNKS:
        return None
    chunks = key.split("/")
    if len(chunks) > 2 and chunks[-2] == kind.chunk:
        return _rmw_topic(chunks[:-2])
    if not all(map(_NAME.fullmatch, chunks)):
        return None
    return Topic(chunks[-1], "/".join(chunks[:-1]), None)


def _rmw_topic(chunks: list[str]) -> Topic | None:
    """The topic of a key's chunks without type and hash. What stands before the domain is the
    `namespace` in the configuration of the node's Zenoh session: one more namespace."""
    for at, chunk in enumerate(chunks):
        if _DOMAIN.fullmatch(chunk):
            before, path = chunks[:at], chunks[at + 1 :]
            if not path or not all(map(_NAME.fullmatch, before + path)):
                return None
            return Topic(path[-1], "/".join(before + path[:-1]), int(chunk))
    return None


# --- liveliness tokens


def publishers(kind: MessageType) -> tuple[str, str]:
    """The key expressions of the tokens of all publishers of a type: of rmw_zenoh, and of all
    topics that bridges publish."""
    return (
        f"**/{_RMW_TOKEN}/*/*/*/*/MP/*/*/*/*/{kind.chunk}/**",
        f"{_BRIDGE_TOKEN}/*/{_RMW_TOKEN}/MP/*/{kind.bridge_chunk}/*",
    )


def histories(data: str) -> str:
    """The key expression of the tokens of publishers that keep messages, for one of data."""
    return f"{data}/{_HISTORY}/pub/**"


def session_histories(data: str, zid: str) -> str:
    """The key expression on which all publishers of a session that keep messages are asked."""
    return f"{data}/{_HISTORY}/pub/{zid}/**"


def parse_publisher(token: str) -> TopicPublisher | None:
    """The publisher of a token; None if it is not the token of one."""
    if len(token) > _MAX_KEY_BYTES:
        return None
    chunks = token.split("/")
    if _RMW_TOKEN not in chunks:
        return None
    at = chunks.index(_RMW_TOKEN)
    if chunks[0] == _BRIDGE_TOKEN:
        return _bridge_publisher(chunks, token)
    session, rest = chunks[:at], chunks[at:]
    if len(rest) < 13 or rest[5] != "MP" or not _DOMAIN.fullmatch(rest[1]):
        return None
    path = [part for part in rest[9].split("%") if part]
    names = [part for part in f"{rest[7]}%{rest[8]}".split("%") if part]
    if not path or not names or not all(map(_NAME.fullmatch, session + path + names)):
        return None
    topic = Topic(path[-1], "/".join(session + path[:-1]), int(rest[1]))
    node, data = "/" + "/".join(session + names), [*session, rest[1], *path, *rest[10:12]]
    # reliability:durability:...
    is_latched = rest[12].split(":")[1:2] == [_TRANSIENT_LOCAL]
    return TopicPublisher(rest[2], topic, node, "/".join(rest), "/".join(data), is_latched)


def _bridge_publisher(chunks: list[str], token: str) -> TopicPublisher | None:
    if len(chunks) != 7 or chunks[2:4] != [_RMW_TOKEN, "MP"]:
        return None
    path = chunks[4].split("§")
    if not all(map(_NAME.fullmatch, path)):
        return None
    topic = Topic(path[-1], "/".join(path[:-1]), None)
    # keyless:reliability:durability:...
    is_latched = chunks[6].split(":")[2:3] == [_TRANSIENT_LOCAL]
    return TopicPublisher(chunks[1], topic, None, token, "/".join(path), is_latched)


def history_publisher(token: str) -> tuple[str, str] | None:
    """The data's key and the publisher's Zenoh id, of the token of a publisher that keeps
    messages; None if it is none."""
    key, found, rest = token.partition(f"/{_HISTORY}/pub/")
    zid = rest.partition("/")[0]
    return (key, zid) if found and key and zid and len(token) <= _MAX_KEY_BYTES else None


def node_token(domain: int, zid: str, name: str) -> str:
    """The token with which a node of rmw_zenoh appears to others."""
    return f"{_RMW_TOKEN}/{domain}/{zid}/0/0/NN/%/%/{name}"


def quality_of_service(durability: int, depth: int) -> str:
    """Of a reliable publisher that keeps its last `depth` messages, as rmw_zenoh writes it."""
    reliable = keep_last = 1
    deadline = lifespan = ","  # seconds and nanoseconds; empty: none
    liveliness = ",,"  # kind, seconds and nanoseconds
    return f"{reliable}:{durability}:{keep_last},{depth}:{deadline}:{lifespan}:{liveliness}"


def publisher_token(
    topic: Topic, zid: str, number: int, name: str, kind: MessageType, hash_: str, qos: str
) -> str:
    """The token of publisher `number` of a node in the root namespace."""
    mangled = topic.path.replace("/", "%")
    return (
        f"{_RMW_TOKEN}/{topic.domain}/{zid}/0/{number}/MP/%/%/{name}/{mangled}"
        f"/{kind.chunk}/{hash_}/{qos}"
    )
