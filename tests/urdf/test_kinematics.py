"""Positions of joints to transforms, against the answers of another implementation."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zenoh_tf import (
    InvalidArgumentException,
    LimitExceeded,
    StampedTransform,
    Transform,
    TransformTree,
)
from zenoh_tf._core import TransformRows
from zenoh_tf.urdf import reader
from zenoh_tf.urdf.kinematics import FrameNames, JointTransforms, fixed_transforms

HERE = Path(__file__).parent
ARM = Path(__file__).resolve().parents[2] / "examples/arm.urdf"
FRAMES = FrameNames("r1")
CASES: list[dict[str, Any]] = json.loads((HERE / "poses.json").read_text())


@pytest.fixture(scope="module")
def arm() -> reader.Robot:
    return reader.read(ARM)


def move(joints: JointTransforms, positions: dict[str, float]) -> dict[str, Transform]:
    """X_parent_child by child."""
    moved = joints.move(list(positions), np.array(list(positions.values())), 1)
    return {stamped.child_frame: stamped.transform for stamped in rows(moved)}


def rows(moved: TransformRows) -> list[StampedTransform]:
    return [
        StampedTransform(moved.names[parent], moved.names[child], 1, Transform(pose[:3], pose[3:]))
        for parent, child, pose in zip(moved.parent, moved.child, moved.pose, strict=True)
    ]


@pytest.mark.parametrize("number", range(len(CASES)))
def test_every_link_is_where_yourdfpy_puts_it(arm: reader.Robot, number: int) -> None:
    case = CASES[number]
    names, positions = list(case["positions"]), np.array(list(case["positions"].values()))
    tree = TransformTree()
    tree.set_transforms_xact(fixed_transforms(arm, FRAMES), static=True)
    tree.set_transforms_xact(rows(JointTransforms(arm, FRAMES).move(names, positions, 1)))
    assert len(case["poses"]) == 11
    for link, expected in case["poses"].items():
        got = tree.lookup_transform("r1/base", f"r1/{link}", 1).transform.matrix()
        np.testing.assert_allclose(got, expected, atol=1e-12)


def test_prefixes() -> None:
    names = FrameNames("/fleet/r1/", ["world", "map"])
    assert [names(link) for link in ("base", "world", "fleet/r1/base", "fleet/r11")] == [
        "fleet/r1/base",
        "world",
        "fleet/r1/base",
        "fleet/r1/fleet/r11",
    ]
    assert FrameNames()("base") == "base"


def test_rotations_are_unit_quaternions(arm: reader.Robot) -> None:
    moved = JointTransforms(arm).move(["pan", "elbow"], np.array([1e6, -300.0]), 1)
    np.testing.assert_allclose(np.linalg.norm(moved.pose[:, 3:], axis=1), 1.0, atol=1e-14)


def test_a_message_moves_its_joints_and_their_mimics(arm: reader.Robot) -> None:
    joints = JointTransforms(arm)
    assert set(move(joints, {"elbow": 0.5})) == {"forearm"}
    got = move(joints, {"left": 0.01, "elbow": 0.5})
    assert set(got) == {"forearm", "left_finger", "right_finger", "knuckle"}
    assert got["right_finger"].translation.tolist() == pytest.approx([0.0, -0.03, 0.1])
    assert joints.counts.transforms == 5


def test_what_is_left_out_is_counted(arm: reader.Robot) -> None:
    joints = JointTransforms(arm)
    positions = {"elbow": math.nan, "wheel": 1.0, "pedestal": 0.0, "slide": math.inf, "roll": 3.5}
    assert set(move(joints, positions)) == {"tool"}
    counts = joints.counts
    assert (counts.unknown_joints, counts.not_numbers, counts.beyond_limits) == (1, 2, 1)
    assert counts.transforms == 1
    assert move(joints, {}) == {}
    assert move(joints, {"pan": 100.0, "elbow": -0.99}) != {}  # continuous joints have no limits
    assert counts.beyond_limits == 1


def test_the_last_of_two_positions_counts(arm: reader.Robot) -> None:
    moved = JointTransforms(arm).move(["slide", "slide"], np.array([0.1, 0.0]), 1)
    assert moved.pose[0, :3].tolist() == pytest.approx([0.2, 0.1, 0.0])


def test_sets_of_names_are_not_remembered_without_end(arm: reader.Robot) -> None:
    joints = JointTransforms(arm)
    for number in range(200):
        move(joints, {"pan": 0.0, f"wheel{number}": 0.0})
    assert joints._plan.cache_info().currsize <= 64


def test_a_robot_that_does_not_move() -> None:
    robot_ = reader.parse(robot(joint("a", "base", "one", "fixed")))
    assert move(JointTransforms(robot_), {"a": 1.0}) == {}
    assert [stamped.child_frame for stamped in fixed_transforms(robot_)] == ["one"]


def joint(name: str, parent: str, child: str, kind: str, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{more}</joint>"
    )


def robot(*joints: str, links: str = "base one two three", before: str = "") -> bytes:
    text = "".join(f'<link name="{link}"/>' for link in links.split()[: len(joints) + 1])
    return f'{before}<robot name="r">{text}{"".join(joints)}</robot>'.encode()


def test_the_reader_knows_the_root_and_the_limits(arm: reader.Robot) -> None:
    assert (arm.name, arm.root, len(arm.joints)) == ("arm", "base", 10)
    elbow = arm.joints[4]
    assert (elbow.name, elbow.lower, elbow.upper) == ("elbow", -1.0, 1.5)
    np.testing.assert_allclose(elbow.axis, [1 / 3, -2 / 3, 2 / 3])


LOOP = (joint("a", "one", "two", "fixed"), joint("b", "two", "one", "fixed"))
DOCTYPE = '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'
REFUSED = {
    "no XML": (b"<robot", "not XML"),
    "nothing": (b"", "not XML"),
    "binary": (bytes(range(256)), "not XML"),
    "an unknown encoding": (b'<?xml version="1.0" encoding="utf-99"?><robot/>', "not XML"),
    "another root": (b"<sdf/>", "<sdf>"),
    "entities": (robot(before=DOCTYPE), "DOCTYPE"),
    "a file of the host": (robot(before='<!DOCTYPE r SYSTEM "/etc/passwd">'), "DOCTYPE"),
    "xacro": (b'<robot name="r"><xacro:include filename="a"/></robot>', "xacro"),
    "no links": (b'<robot name="r"/>', "no links"),
    "no name": (robot(joint("", "base", "one", "fixed")), "<joint> has no name"),
    "no type": (robot(joint("a", "base", "one", "")), "'a': its type is ''"),
    "another type": (robot(joint("a", "base", "one", "hinge")), "'hinge'"),
    "no parent": (b'<robot><link name="b"/><joint name="a" type="fixed"/></robot>', "<parent"),
    "an unknown link": (robot(joint("a", "base", "x", "fixed")), "no link 'x'"),
    "two joints": (
        robot(joint("a", "base", "one", "fixed"), joint("a", "one", "two", "fixed")),
        "two joints 'a'",
    ),
    "two links": (robot(joint("a", "base", "one", "fixed"), links="base base"), "two links 'base'"),
    "two parents": (
        robot(joint("a", "base", "one", "fixed"), joint("b", "two", "one", "fixed")),
        "link 'one' is the child of two",
    ),
    "two roots": (robot(joint("a", "base", "one", "fixed"), ""), "'base', 'two'"),
    "a loop": (robot(*LOOP), "a loop"),
    "nothing but a loop": (robot(*LOOP, links="one two"), "a loop"),
    "letters": (
        robot(joint("a", "base", "one", "fixed", '<origin xyz="0 0 up"/>')),
        "'a': xyz='0 0 up' is not three numbers",
    ),
    "NaN": (robot(joint("a", "base", "one", "fixed", '<origin rpy="0 0 nan"/>')), "three numbers"),
    "two numbers": (robot(joint("a", "base", "one", "fixed", '<origin rpy="0 0"/>')), "rpy='0 0'"),
    "no axis": (robot(joint("a", "base", "one", "prismatic", '<axis xyz="0 0 0"/>')), "axis"),
    "an infinite mimic": (
        robot(joint("a", "base", "one", "revolute", '<mimic joint="a" offset="inf"/>')),
        "offset='inf' is not a number",
    ),
    "a mimic of itself": (
        robot(joint("a", "base", "one", "revolute", '<mimic joint="a"/>')),
        "mimics itself",
    ),
    "mimics in a circle": (
        robot(
            joint("a", "base", "one", "revolute", '<mimic joint="b"/>'),
            joint("b", "one", "two", "revolute", '<mimic joint="a"/>'),
        ),
        "mimics itself",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals(name: str) -> None:
    text, reason = REFUSED[name]
    with pytest.raises(InvalidArgumentException) as refusal:
        reader.parse(text, "robot.urdf")
    assert str(refusal.value).startswith("robot.urdf")
    assert reason in str(refusal.value)


def test_a_mutilated_file_is_refused_or_read(arm: reader.Robot) -> None:
    """Nothing else happens, wherever the damage is."""
    text = ARM.read_bytes()
    random = np.random.default_rng(7)
    outcomes = set()
    for _ in range(2000):
        damaged = bytearray(text)
        at = int(random.integers(len(text) - 8))
        if random.integers(2):
            damaged[at] = int(random.integers(256))
        else:
            del damaged[at : at + int(random.integers(1, 8))]
        try:
            robot_ = reader.parse(bytes(damaged))
            JointTransforms(robot_)
            outcomes.add("read")
        except InvalidArgumentException:
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_a_deep_file_and_a_long_chain() -> None:
    deep = b"<a>" * 100_000 + b"</a>" * 100_000
    assert reader.parse(robot(joint("a", "base", "one", "fixed"))[:-8] + deep + b"</robot>").root
    names = [f"l{number}" for number in range(3000)]
    chain = [joint(f"j{b}", a, b, "fixed") for a, b in itertools.pairwise(names)]
    assert reader.parse(robot(*chain, links=" ".join(names))).root == "l0"


def test_a_file_that_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "MAX_BYTES", 100)
    with pytest.raises(LimitExceeded) as refusal:
        reader.read(ARM)
    assert refusal.value.limit == 100
