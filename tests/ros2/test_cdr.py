"""ROS 2 messages as bytes: against rosbags, in both byte orders, and malformed ones."""

from __future__ import annotations

import random
import struct
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import TransformRows
from zenoh_tf.admission import refused
from zenoh_tf.errors import InvalidArgumentException, LimitExceeded, ProtocolError
from zenoh_tf.ros2.cdr import (
    JointState,
    decode_joint_state,
    decode_tf_message,
    encode_joint_state,
    encode_tf_message,
)

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
NUMBERS = st.floats(allow_nan=False)
STAMPS = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)

#: map -> odom at 100 s and 5 ns: 1, 2, 3, no rotation.
ONE = bytes.fromhex(
    "00010000 01000000 64000000 05000000 04000000 6d617000 05000000 6f646f6d 00 000000"
) + struct.pack("<7d", 1, 2, 3, 0, 0, 0, 1)


def oracle_tf(rows: list[tuple[str, str, int, list[float]]]) -> Any:
    """The message as rosbags has it."""
    header, time = TYPES["std_msgs/msg/Header"], TYPES["builtin_interfaces/msg/Time"]
    vector, turn = TYPES["geometry_msgs/msg/Vector3"], TYPES["geometry_msgs/msg/Quaternion"]
    transform = TYPES["geometry_msgs/msg/Transform"]
    stamped = TYPES["geometry_msgs/msg/TransformStamped"]
    return TYPES["tf2_msgs/msg/TFMessage"](
        [
            stamped(
                header(time(*divmod(stamp, 10**9)), parent),
                child,
                transform(vector(*pose[:3]), turn(*pose[3:])),
            )
            for parent, child, stamp, pose in rows
        ]
    )


def rows_of(message: TransformRows) -> list[tuple[str, str, int, list[float]]]:
    return [
        (message.names[parent], message.names[child], stamp, pose)
        for parent, child, stamp, pose in zip(
            message.parent,
            message.child,
            message.stamp.tolist(),
            message.pose.tolist(),
            strict=True,
        )
    ]


TF_ROWS = st.lists(
    st.tuples(NAMES, NAMES, STAMPS, st.lists(NUMBERS, min_size=7, max_size=7)), max_size=6
)


def test_golden_bytes() -> None:
    row = ("map", "odom", 100_000_000_005, [1.0, 2, 3, 0, 0, 0, 1])
    assert rows_of(decode_tf_message(ONE)) == [row]
    assert encode_tf_message(TransformRows.of_tuples([row])) == ONE
    stamped = StampedTransform("map", "odom", row[2], Transform((1, 2, 3), (0, 0, 0, 1)))
    assert encode_tf_message(TransformRows.of([stamped])) == ONE


@settings(max_examples=200, deadline=None)
@given(TF_ROWS, st.booleans())
def test_transforms_as_rosbags_has_them(rows: list[Any], little: bool) -> None:
    theirs = bytes(
        STORE.serialize_cdr(oracle_tf(rows), "tf2_msgs/msg/TFMessage", little_endian=little)
    )
    assert rows_of(decode_tf_message(theirs)) == rows
    if little:
        ours = encode_tf_message(TransformRows.of_tuples(rows))
        assert ours == theirs[: len(ours)] and not any(theirs[len(ours) :])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(NAMES, max_size=5), NAMES, STAMPS, st.booleans(), st.sampled_from(range(8)), st.data()
)
def test_joints_as_rosbags_has_them(
    names: list[str], frame: str, stamp: int, little: bool, filled: int, data: Any
) -> None:
    arrays = [
        np.array(data.draw(st.lists(NUMBERS, min_size=len(names), max_size=len(names))))
        if filled >> bit & 1
        else np.empty(0)
        for bit in range(3)
    ]
    header = TYPES["std_msgs/msg/Header"](
        TYPES["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), frame
    )
    kind = "sensor_msgs/msg/JointState"
    theirs = bytes(
        STORE.serialize_cdr(TYPES[kind](header, names, *arrays), kind, little_endian=little)
    )
    state = decode_joint_state(theirs)
    assert (state.name, state.frame_id, state.stamp_ns) == (names, frame, stamp)
    for found, sent in zip((state.position, state.velocity, state.effort), arrays, strict=True):
        assert found.dtype == np.float64 and found.tolist() == sent.tolist()
    if little:
        ours = encode_joint_state(state)
        assert ours == theirs[: len(ours)] and not any(theirs[len(ours) :])


def test_names_are_listed_once() -> None:
    message = decode_tf_message(
        encode_tf_message(
            TransformRows.of_tuples(
                [
                    ("map", "a", 1, [0.0] * 7),
                    ("map", "b", 2, [0.0] * 7),
                    ("a", "b", 3, [1.0] * 7),
                ]
            )
        )
    )
    assert message.names == ["map", "a", "b"]
    assert message.parent.tolist() == [0, 0, 1]


def test_frames_get_other_names() -> None:
    rows = decode_tf_message(ONE, rename=lambda names: [f"r1/{name}" for name in names])
    assert rows.names == ["r1/map", "r1/odom"] and rows.child.tolist() == [1]
    with pytest.raises(InvalidArgumentException):
        decode_tf_message(ONE, rename=lambda names: names[:1])


def changed(at: int, value: bytes) -> bytes:
    return ONE[:at] + value + ONE[at + len(value) :]


U32 = struct.Struct("<I").pack


@pytest.mark.parametrize(
    ("payload", "field"),
    [
        (b"", "encapsulation"),
        (b"\0\1\0", "encapsulation"),
        (changed(0, b"\0\3"), "encapsulation"),  # a parameter list
        (changed(0, b"\1\1"), "encapsulation"),
        (ONE[:4], "transforms"),
        (changed(4, U32(2)), "transforms"),
        (changed(4, U32(0xFFFFFFFF)), "transforms"),
        (changed(16, U32(0xFFFFFFFF)), "transforms[0].header.frame_id"),
        (changed(16, U32(3)), "transforms[0].header.frame_id"),  # no zero at its end
        (changed(24, U32(70)), "transforms[0].child_frame_id"),
        (ONE[:-1], "transforms[0].transform.rotation.w"),
        (ONE + bytes(4), "message"),
        (changed(4, U32(0)), "message"),
    ],
)
def test_malformed_transforms_name_the_field(payload: bytes, field: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        decode_tf_message(payload)
    assert caught.value.field == field
    assert field in str(caught.value)


@pytest.mark.parametrize(
    ("at", "data", "reason", "shown"),
    [
        (12, U32(10**9), "bad_stamp", "'odom'"),
        (12, U32(2**32 - 1), "bad_stamp", "'odom'"),
        (20, b"m\0p", "bad_name", "'m\0p'"),
        (28, b"\xff", "bad_name", r"'\xffdom"),
    ],
)
def test_a_row_that_is_no_transform_costs_itself(
    at: int, data: bytes, reason: str, shown: str
) -> None:
    pose = [0.0] * 6 + [1.0]
    links = [("map", "odom", 7, pose), ("map", "arm", 7, pose)]
    payload = bytearray(encode_tf_message(TransformRows.of_tuples(links)))
    payload[at : at + len(data)] = data
    rows = decode_tf_message(bytes(payload))
    tree = TransformTree()
    stored = tree._commit_rows(rows, drop_bad=True)
    found = refused(tree, rows, stored)
    assert found is not None and found.by_reason == {reason: 1} and shown in found.reason
    assert tree.frames() == ["arm", "map"]


def test_a_joint_whose_name_is_no_utf8_costs_itself() -> None:
    state = decode_joint_state(JOINTS[:28] + b"\xff\0" + JOINTS[30:])
    assert state.name == [r"\xff", "b"] and state.position.tolist() == [1.0, 2.0]


JOINTS = encode_joint_state(JointState(["a", "b"], np.array([1.0, 2.0]), stamp_ns=5, frame_id="f"))


@pytest.mark.parametrize(
    ("payload", "field"),
    [
        (JOINTS[:3], "encapsulation"),
        (JOINTS[:7], "header.stamp.sec"),
        (JOINTS[:8] + U32(10**9) + JOINTS[12:], "header.stamp.nanosec"),
        (JOINTS[:20], "name"),
        (JOINTS[:20] + U32(50) + JOINTS[24:], "name"),
        (JOINTS[:24] + U32(500) + JOINTS[28:], "name[0]"),
        (JOINTS[:28] + b"a\1" + JOINTS[30:], "name[0]"),
        (JOINTS[:-12], "position"),
        (JOINTS[:-1], "effort"),
        (JOINTS + bytes(4), "message"),
    ],
)
def test_malformed_joints_name_the_field(payload: bytes, field: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        decode_joint_state(payload)
    assert caught.value.field == field


def test_arrays_of_another_length_are_refused() -> None:
    state = JointState(["a", "b"], np.array([1.0]))
    with pytest.raises(ProtocolError) as caught:
        decode_joint_state(encode_joint_state(state))
    assert caught.value.field == "position"


def test_rows_are_limited() -> None:
    rows = [("map", "odom", 0, [0.0] * 6 + [1.0])] * 4
    payload = encode_tf_message(TransformRows.of_tuples(rows))
    assert len(decode_tf_message(payload, 4)) == 4
    with pytest.raises(LimitExceeded) as caught:
        decode_tf_message(payload, 3)
    assert (caught.value.field, caught.value.limit, caught.value.value) == ("rows", 3, 4)
    joints = encode_joint_state(JointState(["a"] * 4, np.empty(0)))
    with pytest.raises(LimitExceeded):
        decode_joint_state(joints, 3)


def test_a_long_message_is_decoded() -> None:
    row = ("map", "odom", 7, [0.5] * 7)
    message = decode_tf_message(encode_tf_message(TransformRows.of_tuples([row] * 2000)))
    assert message.names == ["map", "odom"] and message.pose.shape == (2000, 7)
    assert set(message.stamp.tolist()) == {7}


@pytest.mark.parametrize("stamp_ns", [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_stamps_beyond_ros_are_refused(stamp_ns: int) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        encode_tf_message(TransformRows.of_tuples([("a", "b", stamp_ns, [0.0] * 7)]))
    assert caught.value.field == "stamp_ns"


@pytest.mark.parametrize(("name", "field"), [("a\0b", "names"), ("\ud800", "frame")])
def test_names_that_cannot_be_sent_are_refused(name: str, field: str) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        encode_tf_message(TransformRows.of_tuples([(name, "b", 0, [0.0] * 7)]))
    assert caught.value.field == field


def test_damaged_messages_raise_typed_errors_only() -> None:
    """Each decoder takes 5,000 damaged messages: it answers, or raises a typed error."""
    random_ = random.Random(18)
    for decode, seed in ((decode_tf_message, ONE * 1), (decode_joint_state, JOINTS)):
        refused = 0
        for _ in range(5000):
            data = bytearray(seed)
            for _ in range(random_.randint(1, 4)):
                data[random_.randrange(len(data))] = random_.choice((0, 1, 4, 127, 128, 255))
            payload = bytes(data[: random_.choice((len(data), random_.randrange(len(data) + 1)))])
            try:
                decode(payload)
            except (ProtocolError, LimitExceeded) as error:
                assert error.field
                refused += 1
        assert refused > 1000


def test_a_forged_count_takes_no_memory() -> None:
    for count in (0xFFFFFFFF, 50_000_000):
        for order in ("<I", ">I"):
            header = b"\0\1\0\0" if order == "<I" else bytes(4)
            with pytest.raises(ProtocolError):
                decode_tf_message(header + struct.pack(order, count))
    assert sys.getsizeof(decode_tf_message(ONE).names) < 200
