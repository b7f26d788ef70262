"""Public reports about URDF files and messages of joint states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from zenoh_tf import InvalidArgumentException
from zenoh_tf.errors import ProtocolError
from zenoh_tf.ros2.cdr import JointState, decode_joint_state, encode_joint_state
from zenoh_tf_tools.urdf import reader
from zenoh_tf_tools.urdf.kinematics import JointTransforms


def robot(*joints: str, more: str = "") -> str:
    """A robot whose joints all hang on ``base``; each is ``name kind`` and the rest of its XML."""
    text = ['<robot name="r"><link name="base"/>']
    for spec in joints:
        name, kind, *rest = spec.split(" ", 2)
        text.append(
            f'<link name="{name}_link"/><joint name="{name}" type="{kind}"><parent link="base"/>'
            f'<child link="{name}_link"/>{rest[0] if rest else ""}</joint>'
        )
    return "".join([*text, more, "</robot>"])


def parsed(*joints: str, more: str = "") -> reader.Robot:
    return reader.parse(robot(*joints, more=more).encode())


def poses(
    joints: JointTransforms, names: Sequence[str], positions: Sequence[float]
) -> dict[str, list[float]]:
    """The pose of each joint that moves, by joint."""
    rows = joints.move(names, np.array(positions), 1)
    children = [rows.names[child].removesuffix("_link") for child in rows.child]
    return dict(zip(children, rows.pose.tolist(), strict=True))


@pytest.mark.parametrize(
    ("encoding", "comment"),
    [
        ("UTF-8", "ゴム ｱﾙﾐ"),
        ("utf-8-sig", "90° 底盘"),
        ("UTF-16", "90° 底盘"),
        ("ISO-8859-1", "Gelenk für 90°"),
        ("GB2312", "机器人底盘"),
        ("gbk", "底盤"),
        ("Shift_JIS", "台車ｱﾙﾐ"),
        ("EUC-KR", "로봇"),
        ("Big5", "底盤"),
    ],
)
def test_a_file_is_read_by_its_own_encoding(tmp_path: Path, encoding: str, comment: str) -> None:
    """ros/joint_state_publisher#57, ros-industrial/fanuc#266, ros/urdf_parser_py#58 and #82,
    iory/scikit-robot#864: tools wrote the declaration and letters that others could not read."""
    declared = encoding.removesuffix("-sig")
    text = f'<?xml version="1.0" encoding="{declared}"?><!-- {comment} -->'
    text += robot("arm continuous", f"{comment.split(maxsplit=1)[0]} fixed")
    file = tmp_path / "robot.urdf"
    file.write_bytes(text.encode(encoding))
    found = reader.read(file)
    assert [joint.name for joint in found.joints] == ["arm", comment.split(maxsplit=1)[0]]


@pytest.mark.parametrize("encoding", ["utf-7", "rot13", "no-such"])
def test_an_encoding_that_cannot_be_read_is_named(encoding: str) -> None:
    """As above: the answer is an error about the file, and no exception of a library."""
    text = f'<?xml version="1.0" encoding="{encoding}"?>{robot("arm continuous")}'
    with pytest.raises(InvalidArgumentException, match=f"robot.urdf.*{encoding}"):
        reader.parse(text.encode(), "robot.urdf")


@pytest.mark.parametrize(
    ("kind", "limit", "q"),
    [
        ("continuous", '<limit lower="-0.5" upper="0.5" effort="2"/>', 7.0),
        ("continuous", '<limit velocity="2"/>', -4.0),
        ("continuous", "", 100.0),
        ("revolute", "", 3.0),
    ],
)
def test_limits_that_are_missing_or_of_no_use(kind: str, limit: str, q: float) -> None:
    """ros/urdfdom#180, Kinovarobotics/kinova-ros#289, ros/robot_model#90, Phylliade/ikpy#94: a
    continuous joint turns on whatever limits stand in the file, and one without limits loads."""
    joints = JointTransforms(parsed(f'arm {kind} <axis xyz="0 0 1"/>{limit}'))
    pose = poses(joints, ["arm"], [q])["arm"]
    np.testing.assert_allclose(pose[3:], (0, 0, math.sin(q / 2), math.cos(q / 2)), atol=1e-12)
    assert joints.counts.beyond_limits == 0


@pytest.mark.parametrize("axis", ["0 0 0", "0.0 0.0 0.0"])
def test_an_axis_of_zero(axis: str) -> None:
    """mmatl/urdfpy#22, gazebosim/gz-sim#2762: exporters write it into fixed joints, where it says
    nothing; a joint that turns about nothing is named."""
    assert parsed(f'plate fixed <axis xyz="{axis}"/>').joints[0].kind == "fixed"
    for kind in ("revolute", "prismatic"):
        with pytest.raises(InvalidArgumentException, match=r"'knee'.*axis.*no direction"):
            parsed(f'knee {kind} <axis xyz="{axis}"/>')


@pytest.mark.parametrize(
    "more",
    [
        '<transmission name="t"><joint name="arm"/><actuator name="m"/></transmission>',
        '<gazebo reference="base"><link name="x"/><joint name="y"/></gazebo>',
        '<ros2_control name="s" type="system"><joint name="arm"><state_interface name="position"/>'
        "</joint></ros2_control>",
        '<group_state name="home"><joint name="arm" value="0"/></group_state>',
    ],
)
def test_elements_of_other_programs_name_joints_too(more: str) -> None:
    """Phylliade/ikpy#59: their links and joints have neither parent nor child, and are not the
    robot's."""
    found = parsed("arm continuous", more=more)
    assert [joint.name for joint in found.joints] == ["arm"]
    assert found.root == "base"


@pytest.mark.parametrize(
    ("origin", "xyz", "yaw"),
    [
        ('<origin xyz="1 0 0"/>', (1, 0, 0), 0.0),
        ('<origin rpy="0 0 1.5"/>', (0, 0, 0), 1.5),
        ("<origin/>", (0, 0, 0), 0.0),
        ('<origin rpy=" 0\n0\t-.5 " xyz="1e-3  +2 -0"/>', (0.001, 2, 0), -0.5),
    ],
)
def test_an_origin_may_be_partial(origin: str, xyz: tuple[float, ...], yaw: float) -> None:
    """SemRoCo/giskardpy#13: each attribute may be left out, and numbers have any white space."""
    found = parsed(f"plate fixed {origin}").joints[0].origin
    np.testing.assert_allclose(found.translation, xyz)
    np.testing.assert_allclose(found.rotation[2:], (math.sin(yaw / 2), math.cos(yaw / 2)))


@pytest.mark.parametrize(
    ("axis", "expected"), [("0 -1 0", (0, -1, 0)), ("0 0 2", (0, 0, 1)), ("1 0 -1", None)]
)
def test_a_mimic_turns_about_its_own_axis(
    axis: str, expected: tuple[float, float, float] | None
) -> None:
    """stack-of-tasks/pinocchio#2761, SemRoCo/giskardpy#186: the leader gives the number, not its
    axis, and a mimic needs no limits."""
    follower = f'finger revolute <axis xyz="{axis}"/><mimic joint="knuckle" multiplier="-1"/>'
    joints = JointTransforms(parsed('knuckle revolute <axis xyz="1 0 0"/>', follower))
    pose = poses(joints, ["knuckle"], [0.4])["finger"]
    unit = np.array(expected or (0.5**0.5, 0, -(0.5**0.5)))
    np.testing.assert_allclose(pose[3:6], unit * math.sin(-0.2), atol=1e-12)


@pytest.mark.parametrize("q", [0.25, -1.0])
def test_a_mimic_that_is_in_the_message_has_its_own_position(q: float) -> None:
    """gkjohnson/urdf-loaders#184: as in robot_state_publisher, a measured position comes before
    the computed one, and does not move the leader."""
    follower = 'finger prismatic <mimic joint="knuckle" multiplier="2" offset="1"/>'
    joints = JointTransforms(parsed("knuckle prismatic", follower))
    both = poses(joints, ["finger", "knuckle"], [q, 0.5])
    assert (both["finger"][0], both["knuckle"][0]) == (q, 0.5)
    alone = poses(joints, ["finger"], [q])
    assert alone["finger"][0] == q
    assert "knuckle" not in alone


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 1, 0, 2)])
def test_a_message_of_other_joints_than_the_file(order: tuple[int, ...]) -> None:
    """gbionics/idyntree#527, ros/robot_state_publisher#83, gt-ros-pkg/hrl-kdl#6: fingers that the
    file lacks, a joint that the message lacks, and another order in each message."""
    joints = JointTransforms(parsed("hip prismatic", "knee prismatic", "ankle prismatic"))
    named = [("hip", 0.1), ("thumb", 9.0), ("knee", 0.2), ("index", 9.0)]
    names, positions = zip(*(named[place] for place in order), strict=True)
    found = poses(joints, names, positions)
    assert {name: pose[0] for name, pose in found.items()} == {"hip": 0.1, "knee": 0.2}
    assert joints.counts.unknown_joints == 2
    assert joints.first["unknown_joints"] in ("thumb", "index")


def message(names: list[str], positions: int, velocities: int = 0) -> bytes:
    state = JointState(
        names, np.ones(positions, np.float64), np.ones(velocities, np.float64), stamp_ns=5
    )
    return encode_joint_state(state)


@pytest.mark.parametrize(("count", "positions"), [(3, 2), (2, 3), (20, 19)])
def test_names_and_positions_of_other_lengths(count: int, positions: int) -> None:
    """strands-labs/robots#3648: which name lost its number is unknown, so no joint is moved to
    another's angle; the message is refused with both counts."""
    with pytest.raises(ProtocolError, match=f"position.*{count} numbers, not {positions}"):
        decode_joint_state(message([f"joint_{number}" for number in range(count)], positions))


@pytest.mark.parametrize("velocities", [2, 0])
def test_a_message_without_positions(velocities: int) -> None:
    """ros/robot_state_publisher#64: wheels that measure velocities alone are no fault."""
    assert len(decode_joint_state(message(["left", "right"], 0, velocities)).position) == 0


@pytest.mark.parametrize(("count", "velocities"), [(2, 1), (3, 6)])
def test_velocities_of_another_length(count: int, velocities: int) -> None:
    """ros-visualization/rviz#731, jsk-ros-pkg/jsk_recognition#2218: velocities and efforts that do
    not fit the names move no joint, so the positions are good."""
    names = [f"joint_{number}" for number in range(count)]
    state = decode_joint_state(message(names, count, velocities))
    assert state.position.tolist() == [1.0] * count
    assert len(state.velocity) == 0
