"""Public reports about drivers: clocks of sensors, stamps that nobody fills in, angles in degrees,
recordings in parts, queues that are too short."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.field.test_doctor_reports import Row, found
from tests.recordings.files import Log, write
from tests.support import command_line
from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    ForwardExtrapolationException,
    LookupException,
    StampedTransform,
    Transform,
    TransformException,
    TransformTree,
    tf2,
)
from zenoh_tf._core import TransformRows
from zenoh_tf_tools.doctor import RecordedFacts, diagnose

S = 10**9
#: When the recordings are of.
WALL_S = 1_795_000_000.0
Capture = pytest.CaptureFixture[str]


def put(tree: TransformTree, parent: str, child: str, stamp_ns: int) -> None:
    tree.set_transform(StampedTransform(parent, child, stamp_ns, Transform((1, 0, 0))), "driver")


def moving(newest_ns: int, parent: str = "odom", child: str = "base") -> TransformTree:
    """A link with a sample every 0.1 s for 2 s."""
    tree = TransformTree()
    for number in range(20, -1, -1):
        put(tree, parent, child, newest_ns - number * S // 10)
    return tree


@pytest.mark.parametrize(
    "boot_s",
    [3484.289833850, 1795.8, 20.0, 40 * 86_400.5, 315_965_245.05],
)
def test_a_sensor_that_counts_from_its_start(boot_s: float) -> None:
    """ouster-lidar/ouster-sdk#1, #74, #214, Livox-SDK/livox_ros_driver#2: clouds whose stamps are
    the seconds since the sensor's start, beside transforms of the real clock;
    LORD-MicroStrain/microstrain_inertial#376: from 1980, where GPS begins."""
    now_ns, boot_ns = time.time_ns(), round(boot_s * S)
    with pytest.raises(BackwardExtrapolationException) as caught:
        moving(now_ns).lookup_transform("odom", "base", boot_ns)
    assert "after 1970, as of a simulation, or of a sensor that counts" in str(caught.value)
    assert "looks like" not in str(caught.value)
    with pytest.raises(ForwardExtrapolationException, match=r"the link's newest stamp .* sensor"):
        moving(boot_ns + 3 * S).lookup_transform("odom", "base", now_ns)
    tree = moving(now_ns)
    put(tree, "base", "radar", boot_ns)
    with pytest.raises(TransformException, match=r"have no time in common: .* of a sensor that"):
        tree.lookup_transform("odom", "radar")


@pytest.mark.parametrize("early_s", [0.04, 3600, 400 * 86_400])
def test_stamps_of_one_clock_are_of_no_other(early_s: float) -> None:
    """SteveMacenski/slam_toolbox#775: a scan of 41 ms before the first transform."""
    begin_ns = 1_748_347_589_883_203_745
    tree = moving(begin_ns + 2 * S)
    with pytest.raises(BackwardExtrapolationException, match=r"too early\)$"):
        tree.lookup_transform("odom", "base", begin_ns - round(early_s * S))


@pytest.mark.parametrize(("ahead_s", "is_tai"), [(36.9, True), (37.05, True), (33, False)])
def test_a_lookup_at_a_time_of_tai(ahead_s: float, is_tai: bool) -> None:
    """ouster-lidar/ouster-ros#53, RoboSense-LiDAR/rslidar_sdk#169: a lidar that has the time from
    PTP, and transforms in UTC."""
    newest_ns = time.time_ns()
    with pytest.raises(ForwardExtrapolationException) as caught:
        moving(newest_ns).lookup_transform("odom", "base", newest_ns + round(ahead_s * S))
    assert ("TAI, the time of PTP, is 37 s ahead of UTC" in str(caught.value)) is is_tai


@pytest.mark.parametrize(
    ("off_s", "words"),
    [
        (36.999, "of TAI, the time of PTP, which is 37 s ahead of UTC"),
        (-37.001, "corrected twice for TAI"),
        (17.9, "of GPS time, which is 18 s ahead of UTC"),
        (8 * 3600 - 0.02, "of local time taken for UTC or the reverse: 8 h"),
        (-5.5 * 3600, "of local time taken for UTC or the reverse: 5.5 h"),
        (30.0, ""),
        (-7000.0, ""),
    ],
)
def test_a_clock_of_another_scale(off_s: float, words: str) -> None:
    """As above, RoboSense-LiDAR/rs_driver#75 and #29, ethz-asl/ethz_piksi_ros#90: TAI from PTP or
    taken from it twice, GPS time, and the time zone of the driver's host."""

    def lidar(number: int, time_s: float) -> Iterable[Row]:
        yield "base", "lidar", time_s + off_s, 0.1 * math.sin(time_s), 0.0

    text = found(lidar)["TF201 lidar"]
    assert words in text
    assert (", as of" in text) is bool(words)


@pytest.mark.parametrize(
    ("rate_hz", "first_s", "words"),
    [
        (20, 100.0, "whole seconds alone"),
        (5, 1_786_275_388.0, "whole seconds alone"),
        (20, 0.5, ""),
        (20, None, "which is 0: nobody fills it in"),
    ],
)
def test_stamps_without_nanoseconds(rate_hz: int, first_s: float | None, words: str) -> None:
    """Minipada/ros2_data_collection#308, HesaiTechnology/HesaiLidar_General_ROS#52,
    cra-ros-pkg/robot_localization#852: a driver loses the nanoseconds of its stamps."""

    def imu(number: int, time_s: float) -> Iterable[Row]:
        if number % (20 // rate_hz) == 0:
            stamp_s = 0.0 if first_s is None else first_s + int(time_s)
            yield "base", "imu", stamp_s, 0.1 * math.sin(time_s), 0.0

    text = found(imu, 400)["TF203 imu"]
    assert words in text
    assert ("which " in text) is bool(words)


def test_a_publisher_that_fills_in_no_stamps() -> None:
    """newkillerwhale/unilidar_fastlio_ros2#3: odometry of a stamp of 0."""
    now_ns = time.time_ns()
    tree = moving(now_ns, "map", "base")
    for _ in range(5):
        put(tree, "base", "arm", 0)
    for stamp_ns in (None, now_ns):
        advice = tree.explain("map", "arm", stamp_ns).advice
        assert [text.partition(",")[0] for text in advice] == [
            "All samples of 'base' -> 'arm' have the stamp 0"
        ]
        assert "'driver'" in advice[0]


@pytest.mark.parametrize(
    ("first_s", "words"),
    [(0.0, "fills in no stamps"), (3484.0, "of a sensor that counts from its start")],
)
def test_the_doctor_tells_no_stamps_from_another_clock(
    tmp_path: Path, capsys: Capture, first_s: float, words: str
) -> None:
    """As above: neither is called a simulation alone."""
    log: Log = [
        (
            WALL_S + n / 20,
            "/tf",
            [
                ("map", "base", WALL_S + n / 20, 1.0),
                ("base", "arm", first_s and first_s + n / 20, 2.0),
            ],
        )
        for n in range(100)
    ]
    done = command_line.call(capsys, "doctor", str(write(tmp_path / "arm", log)))
    (line,) = [line for line in done.stdout.splitlines() if "its newest stamp is" in line]
    assert words in line


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_part_without_static_links(tmp_path: Path, capsys: Capture, kind: str) -> None:
    """ros2/rosbag2#1234, #1159, ros/ros_comm#706: /tf_static is in the first part only."""
    part = write(tmp_path / "part", [(WALL_S, "/tf", [("odom", "base", WALL_S, 1.0)])], kind=kind)
    for command in ("query", "velocity", "estimate"):
        done = command_line.call(capsys, command, str(part), "odom", "camera")
        assert done.returncode == 1
        name, _, note = done.stderr.partition("; ")
        assert name == "zenoh-tf: LookupException: frame 'camera' does not exist"
        assert note.startswith("the recording has no static links: if it is in parts")
    done = command_line.call(capsys, "query", str(part), "odom", "base")
    assert (done.returncode, done.stderr) == (0, "")
    log: Log = [(WALL_S, "/tf_static", [("base", "lidar", 0.0, 1.0)])]
    done = command_line.call(capsys, "query", str(write(tmp_path / "all", log)), "base", "camera")
    assert "static links" not in done.stderr


@pytest.mark.parametrize("turn", ["90", "-180", "0 0 45"])
def test_angles_in_degrees(capsys: Capture, turn: str) -> None:
    """ros/geometry#231, ros/geometry2#576: angles that were copied from another notation."""
    angles = [*turn.split(), "0", "0"][:3]
    done = command_line.call(capsys, "static", "0", "0", "0", *angles, "base", "camera")
    assert done.returncode == 2
    assert "degrees or" in done.stderr


def test_a_whole_turn_in_radians(capsys: Capture) -> None:
    """As above: what may be in radians is read. No server is there to store it."""
    for turn in ("6.2832", "-6.28318530718", "100deg", "100rad"):
        done = command_line.call(
            capsys, *("--connect", "tcp/127.0.0.1:1", "--timeout", "100ms"),
            *("static", "--yaw", turn, "--frame-id", "a", "--child-frame-id", "b"),
        )  # fmt: skip
        assert done.returncode == 1, done.stderr


@pytest.mark.parametrize(("queue_size", "late", "heard"), [(1, 2, 0), (2, 2, 0), (3, 2, 18)])
def test_a_queue_that_is_shorter_than_the_delay(queue_size: int, late: int, heard: int) -> None:
    """SteveMacenski/slam_toolbox#516, ros2/geometry2#544: scans at 20 Hz, transforms that come two
    scans later, and a queue of one message, which tf2 empties each time as well."""
    buffer = tf2.Buffer()
    messages: list[object] = []
    errors: list[str] = []
    with tf2.TransformFilter(None, buffer, "odom", queue_size) as points:
        points.registerCallback(lambda message, transform: messages.append(message))
        points.registerFailureCallback(lambda message, reason, error: errors.append(str(error)))
        tick_ns = S // 20
        for number in range(20):
            stamp = tf2.Time(nanoseconds=100 * S + number * tick_ns)
            points.add(tf2.PointStamped(tf2.Header(stamp, "base"), tf2.Point()))
            if number >= late:
                then = tf2.Time(nanoseconds=100 * S + (number - late) * tick_ns)
                there = tf2.TransformStamped(tf2.Header(then, "odom"), "base")
                there.transform.rotation.w = 1.0
                buffer.set_transform(there, "wheels")
                while len(messages) < min(number - late + 1, heard):
                    time.sleep(0.001)
    assert len(messages) == heard
    assert len(errors) == (0 if heard else 20 - queue_size)
    for text in errors:
        assert "it must hold as many as come while a transform is late" in text


@pytest.mark.parametrize("static_first", [True, False])
def test_a_link_that_is_static_after_a_clear(static_first: bool) -> None:
    """ros2/geometry2#150: a lookup failed if the link had been moving before."""
    buffer = tf2.Buffer()
    there = tf2.TransformStamped(tf2.Header(tf2.Time(nanoseconds=S), "foo"), "bar")
    there.transform.rotation.w = 1.0
    add = buffer.set_transform_static if static_first else buffer.set_transform
    add(there, "one")
    buffer.clear()
    buffer.set_transform_static(there, "one")
    for stamp in (tf2.Time(), tf2.Time(nanoseconds=7 * S)):
        assert buffer.lookup_transform("foo", "bar", stamp).transform == there.transform


@pytest.mark.parametrize("turn_rad", [math.pi / 2, -math.pi / 2, 0.3])
def test_a_covariance_turns_with_its_pose(turn_rad: float) -> None:
    """ros2/geometry2#372, #431: it was copied."""
    pose = SimpleNamespace(
        pose=SimpleNamespace(
            position=tf2.Point(x=1.0), orientation=tf2.Quaternion(0.0, 0.0, 0.0, 1.0)
        ),
        covariance=np.diag([4.0, 1.0, 0.0, 0.0, 0.0, 9.0]).ravel().tolist(),
    )
    header = tf2.Header(tf2.Time(nanoseconds=S), "base")
    turn = tf2.TransformStamped(tf2.Header(tf2.Time(nanoseconds=S), "map"), "base")
    turn.transform.rotation = tf2.Quaternion(
        0.0, 0.0, math.sin(turn_rad / 2), math.cos(turn_rad / 2)
    )
    message = SimpleNamespace(header=header, pose=pose)
    turned = tf2.do_transform_pose_with_covariance_stamped(message, turn).pose
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    by_hand = np.array([[cos, -sin], [sin, cos]])
    expected = by_hand @ np.diag([4.0, 1.0]) @ by_hand.T
    covariance = np.array(turned.covariance).reshape(6, 6)
    assert covariance[:2, :2].ravel().tolist() == pytest.approx(expected.ravel().tolist())
    assert covariance[5, 5] == pytest.approx(9)


@pytest.mark.parametrize("prefix", ["robot1", "uav_2"])
def test_a_prefix_without_its_slash(prefix: str) -> None:
    """ros/robot_state_publisher#139: a state publisher that writes robot1base_link, below the
    robot1/base_link of the odometry."""
    tree = moving(time.time_ns(), f"{prefix}/odom", f"{prefix}/base_link")
    put(tree, f"{prefix}base_link", f"{prefix}lidar", time.time_ns())
    with pytest.raises(LookupException, match=f"did you mean '{prefix}lidar'"):
        tree.lookup_transform(f"{prefix}/odom", f"{prefix}/lidar")
    with pytest.raises(ConnectivityException) as caught:
        tree.lookup_transform(f"{prefix}/odom", f"{prefix}lidar")
    assert f"their roots are '{prefix}/odom' and '{prefix}base_link'" in str(caught.value)


@pytest.mark.parametrize("prefix", ["", "uav1/"])
def test_trees_of_an_autopilot_that_nothing_joins(prefix: str) -> None:
    """mavlink/mavros#1293, #1388: the driver's odom -> odom_ned and base_link -> base_link_frd, and
    a localisation with other names."""
    tree = moving(time.time_ns(), f"{prefix}map", f"{prefix}fcu")
    put(tree, f"{prefix}odom", f"{prefix}odom_ned", S)
    with pytest.raises(ConnectivityException, match="their roots are"):
        tree.lookup_transform(f"{prefix}odom_ned", f"{prefix}fcu")
    (advice,) = tree.explain(f"{prefix}odom_ned", f"{prefix}fcu").advice
    assert advice.startswith("Publish the link that joins them")


@pytest.mark.parametrize("back_s", [4294.967296, 86_400.0])
def test_a_clock_that_begins_again(back_s: float) -> None:
    """seqsense/urg_stamped#200, ros2/rosbag2#2094: a counter of microseconds in 32 bits, and a
    recording of the day before. What is dropped has advice for a file as well."""
    facts = RecordedFacts()
    for number in range(200):
        arrival_s = WALL_S + number / 20
        stamp_s = arrival_s - (back_s if number >= 100 else 0)
        rows = TransformRows.of_tuples(
            [("odom", "base", round(stamp_s * S), (number / 20, 0, 0, 0, 0, 0, 1))]
        )
        facts.add(round((arrival_s + 0.01) * S), "/tf", False, rows)
    (finding,) = [each for each in diagnose(facts.facts()) if each.fault.id == "TF204"]
    assert finding.evidence.startswith("100 transforms were older")
    assert "which a recording does not have" in finding.fault.remedy
    assert "its clock was set back" in finding.fault.remedy
