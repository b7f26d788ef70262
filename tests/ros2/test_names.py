"""Keys, tokens and attachments of ROS 2, and the names that robots' frames get."""

from __future__ import annotations

import argparse
import struct

import pytest

from zenoh_tf.errors import InvalidArgumentException, ProtocolError
from zenoh_tf.ros2 import attachment, keys
from zenoh_tf.ros2.attachment import Attachment
from zenoh_tf.ros2.keys import JOINT_STATE, NO_HASH, TF_MESSAGE, Topic
from zenoh_tf_server.ingest.prefixes import Prefixes, parse_rule

TYPE = "tf2_msgs::msg::dds_::TFMessage_"


@pytest.mark.parametrize(
    ("key", "topic"),
    [
        (f"0/tf/{TYPE}/{TF_MESSAGE.hash}", Topic("tf", "", 0)),
        (f"1/tf_static/{TYPE}/{NO_HASH}", Topic("tf_static", "", 1)),
        (f"42/fleet/robot1/tf/{TYPE}/RIHS02_1", Topic("tf", "fleet/robot1", 42)),
        (f"site/7/robot1/tf/{TYPE}/{NO_HASH}", Topic("tf", "site/robot1", 7)),  # session namespace
        ("tf", Topic("tf", "", None)),
        ("robot1/tf_static", Topic("tf_static", "robot1", None)),
        (f"0/{TYPE}/{NO_HASH}", None),
        (f"tf/{TYPE}/{NO_HASH}", None),
        (f"0/1tf/{TYPE}/{NO_HASH}", None),
        (f"0/a b/tf/{TYPE}/{NO_HASH}", None),
        (f"99999999999/tf/{TYPE}/{NO_HASH}", None),
        (f"0/tf/other/{NO_HASH}", None),
        ("robot 1/tf", None),
        ("é/tf", None),
        ("/".join(["a"] * 40 + ["tf"]), None),
        ("a" * 3000 + "/tf", None),
    ],
)
def test_topics_of_keys(key: str, topic: Topic | None) -> None:
    assert keys.parse_data(key, TF_MESSAGE) == topic
    if topic is not None and topic.domain is not None and not key.startswith("site"):
        assert keys.rmw_key(topic, TF_MESSAGE, key.rpartition("/")[2]) == key


def test_keys_of_other_types() -> None:
    key = keys.rmw_key(Topic("joint_states", "arm", 3), JOINT_STATE, JOINT_STATE.hash)
    assert key == f"3/arm/joint_states/sensor_msgs::msg::dds_::JointState_/{JOINT_STATE.hash}"
    assert keys.parse_data(key, JOINT_STATE) == Topic("joint_states", "arm", 3)
    assert keys.parse_data(key, TF_MESSAGE) is None


TOKEN = f"@ros2_lv/2/aa11/0/7/MP/%/%fleet%robot1/nav/%fleet%robot1%tf/{TYPE}/{NO_HASH}/1:2:1,9"


def test_publishers_of_tokens() -> None:
    found = keys.parse_publisher(TOKEN)
    assert found is not None
    assert (found.zid, found.node, found.token) == ("aa11", "/fleet/robot1/nav", TOKEN)
    assert found.topic == Topic("tf", "fleet/robot1", 2)
    assert found.data == f"2/fleet/robot1/tf/{TYPE}/{NO_HASH}" and not found.is_latched
    longer = keys.parse_publisher(f"{TOKEN}/cpu")  # newer releases append something
    assert longer is not None and longer.topic == found.topic
    within = keys.parse_publisher(f"site/{TOKEN}")
    assert within is not None and within.topic.namespace == "site/fleet/robot1"
    assert within.token == TOKEN  # whose hash the node sends
    assert within.data == f"site/{found.data}"
    bridge = keys.parse_publisher("@/bb22/@ros2_lv/MP/robot1§tf/tf2_msgs§msg§TFMessage/:1:0:0,1")
    assert bridge is not None
    assert (bridge.zid, bridge.node) == ("bb22", None)
    assert bridge.topic == Topic("tf", "robot1", None)
    assert bridge.data == "robot1/tf" and not bridge.is_latched
    for token, latched in (
        (TOKEN.replace("/1:2:1,9", "/1:1:1,1:,:,:,,"), True),
        (TOKEN.replace("/1:2:1,9", "/:1:"), True),
        (TOKEN.replace("/1:2:1,9", "/1::1,1"), False),
        (TOKEN.replace("/1:2:1,9", "/none"), False),
        ("@/bb22/@ros2_lv/MP/tf_static/tf2_msgs§msg§TFMessage/:1:1:0,10", True),
        ("@/bb22/@ros2_lv/MP/tf_static/tf2_msgs§msg§TFMessage/none", False),
    ):
        one = keys.parse_publisher(token)
        assert one is not None and one.is_latched == latched, token


@pytest.mark.parametrize(
    "token",
    [
        "",
        "@ros2_lv",
        TOKEN.replace("/MP/", "/MS/"),
        TOKEN.replace("@ros2_lv/2/", "@ros2_lv/two/"),
        TOKEN.replace("%tf/", "%t f/"),
        TOKEN.rpartition("/")[0],
        "@/bb22/@ros2_lv/MP/robot1§tf",
        "@/bb22/@ros2_lv/MP/§/tf2_msgs§msg§TFMessage/:1:0:0,1",
        "x" * 5000,
    ],
)
def test_other_tokens_are_no_publishers(token: str) -> None:
    assert keys.parse_publisher(token) is None


def test_publishers_that_keep_messages() -> None:
    key = f"0/tf_static/{TYPE}/{NO_HASH}"
    assert keys.history_publisher(f"{key}/@adv/pub/aa11/7/_") == (key, "aa11")
    assert keys.history_publisher("tf_static/@adv/pub/bb22/uhlc/_") == ("tf_static", "bb22")
    for token in (key, "/@adv/pub/aa11/7/_", f"{key}/@adv/pub/"):
        assert keys.history_publisher(token) is None


GID = bytes(range(16))
OLD = (
    b"\x0fsequence_number"
    + struct.pack("<q", 5)
    + b"\x10source_timestamp"
    + struct.pack("<q", -6)
    + b"\x0asource_gid\x10"
    + GID
)


def test_attachments() -> None:
    wanted = Attachment(5, -6, GID)
    for data in (
        struct.pack("<qqB", 5, -6, 16) + GID,
        struct.pack("<qq", 5, -6) + GID,
        OLD,
    ):
        assert attachment.decode(data) == wanted
    assert attachment.encode(wanted) == struct.pack("<qqB", 5, -6, 16) + GID


@pytest.mark.parametrize(
    "data", [b"", b"\0", bytes(31), bytes(33), bytes(len(OLD)), OLD[:-1], OLD + b"\0", bytes(34)]
)
def test_malformed_attachments(data: bytes) -> None:
    with pytest.raises(ProtocolError) as caught:
        attachment.decode(data)
    assert caught.value.field == "attachment"


def test_the_id_of_a_token() -> None:
    """XXH3 of 128 bits, the low half first: the reference's value for no input."""
    assert attachment.gid_of("") == bytes.fromhex("7f498d4624c30160d8984701d306aa99")


@pytest.mark.parametrize(
    ("rules", "topic", "zid", "prefix"),
    [
        ([], Topic("tf", "robot1", 7), "aa", ""),
        (["namespace"], Topic("tf", "robot1", 7), "aa", "robot1"),
        (["namespace"], Topic("tf", "fleet/robot1", None), None, "fleet/robot1"),
        (["namespace"], Topic("tf", "", 7), "aa", ""),
        (["domain"], Topic("tf", "robot1", 7), "aa", "7"),
        (["domain"], Topic("tf", "robot1", None), "aa", ""),
        (["session"], Topic("tf", "robot1", 7), "aa", "aa"),
        (["domain", "namespace"], Topic("tf", "robot1", 7), "aa", "robot1"),
        (["domain", "namespace"], Topic("tf", "", 7), "aa", "7"),
        (["namespace", "namespace:robot1=r1"], Topic("tf", "robot1", 7), "aa", "r1"),
        (["namespace", "domain:7=seven"], Topic("tf", "robot1", 7), "aa", "seven"),
        (["namespace", "domain:8=eight"], Topic("tf", "robot1", 7), "aa", "robot1"),
        (["session:aa=a/b", "namespace:robot1=r1"], Topic("tf", "robot1", 7), "aa", "a/b"),
        (["namespace:/robot1/=r1"], Topic("tf", "robot1", 7), "aa", "r1"),
    ],
)
def test_prefixes(rules: list[str], topic: Topic, zid: str | None, prefix: str) -> None:
    assert Prefixes([*map(parse_rule, rules)]).prefix(topic, zid) == prefix


def test_a_session_that_is_not_known_is_an_error() -> None:
    rules = Prefixes([parse_rule("session")])
    with pytest.raises(InvalidArgumentException) as caught:
        rules.prefix(Topic("tf", "", 0), None)
    assert caught.value.field == "ros2_prefix"


@pytest.mark.parametrize(
    "rule",
    ["", "robot", "namespace:", "namespace:robot1", "namespace:=r", "domain:7=", "domain:7=a b"],
)
def test_wrong_rules(rule: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        parse_rule(rule)


def test_names_of_frames() -> None:
    rename = Prefixes(shared=["map", "/world"]).renamer("robot1")
    names = ["base", "/base", "map", "/map", "world", "robot1/base", "/robot1/base", "robot10/x"]
    wanted = [
        *("robot1/base", "robot1/base", "map", "map", "world"),
        *("robot1/base", "robot1/base", "robot1/robot10/x"),
    ]
    assert rename(names) == wanted
    assert rename(names) == wanted  # once more, from what is remembered
    assert Prefixes().renamer("")(["/base", "map", ""]) == ["base", "map", ""]
