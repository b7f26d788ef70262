"""`zenoh_tf.urdf.Urdf`: all links at once, in a tree, through a client and a broadcaster."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import InvalidArgumentException, TransformTree
from zenoh_tf.urdf import Urdf, reader
from zenoh_tf.urdf.kinematics import JointTransforms

ARM = Path(__file__).parents[2] / "examples/arm.urdf"
S = 10**9


def test_all_links_are_there_at_once_and_move_together() -> None:
    tree = TransformTree()
    arm = Urdf(ARM, tree, prefix="r1", stamp_ns=S)
    robot = reader.read(ARM)
    links = {robot.root, *(joint.child for joint in robot.joints)}
    assert set(tree.frames()) == {f"r1/{link}" for link in links}
    assert (arm.name, arm.root) == ("arm", "base")
    assert set(arm.positions.values()) == {0.0}
    mimics = {joint.name for joint in robot.joints if joint.mimic}
    assert mimics
    assert not mimics & set(arm.joints)
    for i, call in enumerate(
        (
            lambda ns: arm.set_joints({"elbow": 0.5, "slide": 0.1}, ns),
            lambda ns: arm.publish(np.linspace(-1, 1, len(arm.joints)), ns),
        ),
        start=2,
    ):
        call(i * S)
        moving = [tree.frame(f"r1/{joint.child}") for joint in robot.of_kind(*reader.MOVING)]
        assert {frame.newest_stamp_ns for frame in moving} == {i * S}
        # As the kinematics say, which tests/urdf/test_kinematics.py compares with another reader's.
        names = list(arm.positions)
        rows = JointTransforms(robot).move(names, np.array(list(arm.positions.values())), i * S)
        for parent, child, pose in zip(rows.parent, rows.child, rows.pose, strict=True):
            found = tree.lookup_transform(
                f"r1/{rows.names[parent]}", f"r1/{rows.names[child]}", i * S
            ).transform
            np.testing.assert_allclose(found.pose(), pose, atol=1e-12)
    assert tree.frame("r1/camera").static
    assert tree.frame("r1/camera").authority == "urdf"


def test_a_joint_that_mimics_another_follows_until_it_is_given() -> None:
    tree = TransformTree()
    arm = Urdf(ARM, tree, stamp_ns=S)
    robot = reader.read(ARM)
    mimic = next(joint for joint in robot.joints if joint.mimic)
    before = tree.lookup_transform(mimic.parent, mimic.child, S).transform
    arm.set_joints({mimic.mimic.joint: 0.02}, 2 * S)  # type: ignore[union-attr]
    followed = tree.lookup_transform(mimic.parent, mimic.child, 2 * S).transform
    assert not np.allclose(before.pose(), followed.pose())
    arm.set_joints({mimic.name: 0.0}, 3 * S)
    assert mimic.name in arm.positions
    given = tree.lookup_transform(mimic.parent, mimic.child, 3 * S).transform
    np.testing.assert_allclose(given.pose(), before.pose(), atol=1e-12)


def test_only_the_first_position_is_within_the_limits(tmp_path: Path) -> None:
    file = tmp_path / "knee.urdf"
    file.write_text(
        '<robot name="knee"><link name="a"/><link name="b"/><joint name="knee" type="revolute">'
        '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="1" upper="2" effort="1" velocity="1"/></joint></robot>'
    )
    tree = TransformTree()
    knee = Urdf(file, tree, stamp_ns=S)
    assert knee.positions == {"knee": 1.5}
    knee.set_joints({"knee": 2.5}, 2 * S)
    rpy = tree.lookup_transform("a", "b", 2 * S).transform.rpy()
    np.testing.assert_allclose(rpy, (0.0, 0.0, 2.5), atol=1e-12)


def test_wrong_positions_store_nothing() -> None:
    tree = TransformTree()
    arm = Urdf(ARM, tree, stamp_ns=S)
    positions = arm.positions
    fixed = reader.read(ARM).of_kind("fixed")[0].name
    for given, field, words in (
        ({"elbow": math.nan}, "elbow", "the position of joint 'elbow' is nan"),
        ({"elbow": 1.0, "elbo": 1.0}, "elbo", "no joint 'elbo'; did you mean 'elbow'\\?$"),
        ({"xyz": 1.0}, "xyz", "robot 'arm' has no joint 'xyz'$"),
        ({fixed: 1.0}, fixed, f"joint '{fixed}' does not move: it is fixed"),
    ):
        with pytest.raises(InvalidArgumentException, match=words) as caught:
            arm.set_joints(given, 2 * S)
        assert caught.value.field == field
    with pytest.raises(InvalidArgumentException, match="see `joints`"):
        arm.publish([0.0], 2 * S)
    with pytest.raises(InvalidArgumentException):  # far before the cache
        arm.publish([1.0] * len(arm.joints), -(10**12))
    assert arm.positions == positions
    elbow = next(joint for joint in reader.read(ARM).joints if joint.name == "elbow")
    assert tree.frame(elbow.child).newest_stamp_ns == S
    with pytest.raises(OSError, match=r"no\.urdf"):
        Urdf("no.urdf", tree)


def test_through_a_client_and_a_broadcaster(server: ServerProcess) -> None:
    with server.connect() as tf:
        one = Urdf(ARM, tf, prefix="one")
        one.set_joints({"elbow": 0.5})
        with tf.broadcaster("arm") as broadcaster:
            two = Urdf(ARM, broadcaster, prefix="two")
            two.set_joints({"elbow": 0.5})
            robot = reader.read(ARM)
            elbow = next(joint for joint in robot.joints if joint.name == "elbow")
            want = tf.lookup_transform(f"one/{elbow.parent}", f"one/{elbow.child}").transform
            wait_until(
                lambda: (
                    f"two/{elbow.child}" in tf.frames()
                    and np.allclose(
                        tf.lookup_transform(
                            f"two/{elbow.parent}", f"two/{elbow.child}"
                        ).transform.pose(),
                        want.pose(),
                    )
                )
            )
            assert tf.frame("two/camera").authority == "arm"
