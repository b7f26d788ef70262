"""Public reports about faults, as the doctor finds them in what was recorded."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import pytest

from zenoh_tf._core import TransformRows
from zenoh_tf_tools.doctor import RecordedFacts, diagnose

S = 10**9
#: Parent, child, stamp in seconds, x in metres, yaw in radians.
Row = tuple[str, str, float, float, float]


def found(rows_at: Callable[[int, float], Iterable[Row]], samples: int = 200) -> dict[str, str]:
    """The evidence of each fault by its id and subject, of a robot whose wheels send 20 times a
    second. `rows_at` gives what else is sent then, of the sample's number and time."""
    facts = RecordedFacts()
    for number in range(samples):
        time_s = number / 20
        sent = [("odom", "base", time_s, time_s, 0.0), *rows_at(number, time_s)]
        rows = TransformRows.of_tuples(
            (parent, child, round(stamp_s * S), pose(x, yaw))
            for parent, child, stamp_s, x, yaw in sent
        )
        facts.add(round((time_s + 0.01) * S), "/tf", False, rows)
    return {f"{each.fault.id} {each.subject}": each.evidence for each in diagnose(facts.facts())}


def pose(x: float, yaw: float) -> tuple[float, ...]:
    return (x, 0.0, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


@pytest.mark.parametrize(("every", "at_rad"), [(97, 1.2), (400, -1.5), (1250, 2.5)])
def test_a_driver_that_sends_zeros_now_and_then(every: int, at_rad: float) -> None:
    """UniversalRobots/Universal_Robots_ROS_Driver#302: single joint states of zeros between the
    measured ones."""

    def arm(number: int, time_s: float) -> Iterable[Row]:
        yaw = 0.0 if number % every == every - 1 else at_rad + 0.3 * math.sin(time_s)
        yield "base", "shoulder", time_s, 0.1, yaw

    faults = found(arm, 2500)
    assert [*faults] == ["TF403 shoulder"]
    assert "degrees within" in faults["TF403 shoulder"]


@pytest.mark.parametrize("turn_rad", [0.9, 2.9, 6.0])
def test_a_wheel_that_turns_fast_is_no_fault(turn_rad: float) -> None:
    """As above: up to most of a turn between two samples, with pauses."""
    angles = [0.0]
    for number in range(400):
        angles.append(angles[-1] + (turn_rad if number % 40 < 25 else 0.0))
    assert found(lambda n, t: [("base", "wheel", t, 0.2, angles[n])], 400) == {}


@pytest.mark.parametrize("tags", [["tag_0"], ["tag36h11:7", "tag_3"]])
def test_one_marker_seen_by_two_cameras(tags: list[str]) -> None:
    """AprilRobotics/apriltag_ros#113, christianrauch/apriltag_ros#32: the tag has the camera as its
    parent that saw it last."""

    def seen(number: int, time_s: float) -> Iterable[Row]:
        camera = "left" if number % 2 else "right"
        yield from (("base", name, time_s, 0.1, 0.0) for name in ("left", "right"))
        yield from ((camera, tag, time_s, 2.0, 0.0) for tag in tags)

    faults = found(seen)
    for tag in tags:
        evidence = faults.pop(f"TF102 {tag}")
        assert "'left'" in evidence and "'right'" in evidence
    assert faults == {}


@pytest.mark.parametrize("tolerance_s", [0.3, 1.0])
def test_stamps_ahead_on_purpose(tolerance_s: float) -> None:
    """cra-ros-pkg/robot_localization#153, ros/robot_state_publisher#131: corrections that are
    repeated with a tolerance, and mounts that are sent half a second ahead, are no fault. A filter
    that moves all the time looks like a wrong clock, and both explanations are given."""

    def mounts(_: int, time_s: float) -> Iterable[Row]:
        yield "base", "laser", time_s + 0.5, 0.2, 0.0
        yield "base", "imu", time_s + 0.5, 0.0, 0.1

    assert found(mounts) == {}
    repeated = found(lambda n, t: [("map", "odom", t + tolerance_s, 0.01 * (n // 3), 0.0)])
    assert repeated == {}
    filtered = found(lambda n, t: [("map", "odom", t + tolerance_s, 0.001 * n, 0.0)])
    assert [*filtered] == ["TF201 odom"]
    assert "unless it stamps ahead on purpose" in filtered["TF201 odom"]
    # Wheels that are ahead are a clock's fault, whatever is fixed to them.
    wrong = found(lambda n, t: [("odom2", "base2", t + tolerance_s, 0.001 * n, 0.0)])
    assert "on purpose" not in wrong["TF201 base2"]


@pytest.mark.parametrize("stopped_s", [2.0, 5.0])
def test_an_arm_that_rests_keeps_its_old_stamp(stopped_s: float) -> None:
    """tesseract-robotics/tesseract_ros2#188, heuristicus/spot_ros#142: the same transform again and
    again with the time of the last movement, so that lookups at the present fail."""
    faults = found(lambda n, t: [("base", "arm", min(t, stopped_s), 0.5, 0.0)])
    assert [*faults] == ["TF203 arm"]
    assert "a stamp that the link had already" in faults["TF203 arm"]


@pytest.mark.parametrize("frame", ["map", "cam0"])
def test_a_frame_in_itself(frame: str) -> None:
    """usdot-fhwa-stol/carma-platform#833, ethz-asl/voxblox#315: the other rows of the same messages
    are stored, and the refused one is named."""
    faults = found(lambda n, t: [(frame, frame, t, 0.0, 0.0)])
    assert [*faults] == ["TF106 /tf"]
    assert f"'{frame}'" in faults["TF106 /tf"]


@pytest.mark.parametrize("frames", [["velodyne"], ["laser", "camera"]])
def test_a_mount_that_was_sent_once_as_moving(frames: list[str]) -> None:
    """RobustFieldAutonomyLab/LeGO-LOAM#230, ApolloAuto/apollo#5447: /tf_static was remapped to /tf,
    so that lookups at other times than that of its only sample fail."""

    def mounts(number: int, time_s: float) -> Iterable[Row]:
        if number == 3:
            yield from (("base", frame, time_s, 0.2, 0.0) for frame in frames)

    assert found(mounts, 150) == {}, "a slow publisher may send again"
    faults = found(mounts, 300)
    assert {*faults} == {f"TF104 {frame}" for frame in frames}
    for evidence in faults.values():
        assert "its only sample came" in evidence and "as static" in evidence


def test_a_recording_that_has_a_pose_of_each_link_is_no_fault() -> None:
    """As above: nothing continues, so a snapshot of a tree says nothing about its publishers."""
    facts = RecordedFacts()
    rows = [("odom", "base", S, pose(1.0, 0.0)), ("base", "arm", 99 * S, pose(0.1, 0.0))]
    facts.add(S, "/tf", False, TransformRows.of_tuples(rows))
    facts.add(99 * S, "/tf_static", True, TransformRows.of_tuples([("base", "box", 0, rows[1][3])]))
    assert diagnose(facts.facts()) == []
