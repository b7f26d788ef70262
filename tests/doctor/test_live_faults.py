"""The doctor on a real server, whose robots each have a fault of their own, or none."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator

import pytest

from tests.processes.servers import ServerProcess
from tests.support import command_line
from tests.support.waiting import wait_until
from zenoh_tf import AuthorityInfo, StampedTransform, Transform
from zenoh_tf_client import Broadcaster, TransformClient

from .faults import FAULTS, Found, Make, beside, moving
from .healthy import parked, steady
from .ward import END_S, START_S, Robot, pose

#: Where a robot's time of 0 s is, after the beginning.
_LEAD_S = 2.0
ROBOTS: dict[str, tuple[Make, Found]] = {
    "steady": (steady, set()),
    "parked": (parked, set()),
    "replaced_before_the_doctor_came": (
        beside(Robot.mount, "camera", pose(0.32, 0.0, 0.5), -0.5, "calibration"),
        {("TF402", "camera")},
    ),
    "one_stamp_ahead_before_the_doctor_came": (
        moving(stamp=lambda t: t + (60 if t == -1 else 0)),
        {("TF202", "base")},
    ),
    # So fast that the delays of a loaded machine do not hide it.
    "fast_clock": (moving(stamp=lambda t: t + 0.2 * (t - START_S)), {("TF206", "wheels")}),
}
for _name in (
    *("two_publishers", "stopped", "clock_ahead", "clock_behind", "frozen_stamp", "simulated_time"),
    *("jitter", "static_that_changes", "static_of_two_authorities", "slow_link", "out_of_order"),
    *("jump", "mount_in_millimetres", "loose_mount", "one_stamp_a_minute_ahead", "frozen_pose"),
    *("identical_statics", "bursts", "optical_frame"),
):
    ROBOTS[_name] = FAULTS[_name]
#: Names that all robots have below their own name.
SHARED = {"TF301"}


def publish(tf: TransformClient, robots: dict[str, Robot], begun: threading.Event) -> None:
    """Send what the robots send, from 2 s before their 0 s on."""
    sent = sorted(
        (each for name, robot in robots.items() for each in named(name, robot)),
        key=lambda row: row[0],
    )
    begin_ns = time.time_ns() + round(_LEAD_S * 1e9)
    broadcasters: dict[str, Broadcaster] = {}
    for arrival_s, authority, static, stamped_s, (parent, child), value in sent:
        due_s = begin_ns / 1e9 + arrival_s - time.time()
        if due_s > 0:
            time.sleep(due_s)
        if arrival_s >= 0:
            begun.set()
        row = StampedTransform(
            parent, child, begin_ns + round(stamped_s * 1e9), Transform(value[:3], value[3:])
        )
        if authority not in broadcasters:
            broadcasters[authority] = tf.broadcaster(authority)
        send = broadcasters[authority].send_static if static else broadcasters[authority].send
        send(row)
    for broadcaster in broadcasters.values():
        broadcaster.close()


Row = tuple[float, str, bool, float, tuple[str, str], tuple[float, ...]]


def named(name: str, robot: Robot) -> Iterator[Row]:
    for at_s, authority, static, parent, child, stamp_s, value in robot.sent:
        arrival_s = max(at_s, -_LEAD_S) if static else at_s
        if arrival_s >= -_LEAD_S:
            link = (f"{name}/{parent}", f"{name}/{child}")
            yield arrival_s, f"{name}/{authority}", static, stamp_s, link, value


def test_a_reset_forgets_why_transforms_were_refused(server: ServerProcess) -> None:
    with server.connect() as tf, tf.broadcaster("closes a loop") as broadcaster:

        def record() -> AuthorityInfo:
            (found,) = (each for each in tf.authorities() if each.name == "closes a loop")
            return found

        def doctor() -> command_line.Done:
            return command_line.run("--connect", server.endpoint, "doctor", "--for", "0")

        broadcaster.send(StampedTransform("map", "base", 1, Transform()))
        broadcaster.send(StampedTransform("base", "map", 1, Transform()))
        wait_until(lambda: "closes a loop" in {each.name for each in tf.authorities()})
        wait_until(lambda: record().last_refusal)
        refused = record().refused
        assert "TF106  transforms that were refused" in doctor().stdout
        tf.reset()
        assert (record().refused, record().last_refusal) == (refused, None)
        assert (doctor().stdout, doctor().returncode) == ("no faults in 0 frames\n", 0)


@pytest.mark.slow
@pytest.mark.own_server
def test_robots_with_faults(server: ServerProcess) -> None:
    robots, expected = {}, set()
    for name, (make, found) in ROBOTS.items():
        robots[name] = Robot()
        make(robots[name])
        expected |= {(fault, f"{name}/{subject}") for fault, subject in found}
    with server.connect() as tf:
        begun = threading.Event()
        publisher = threading.Thread(target=publish, args=(tf, robots, begun))
        publisher.start()
        assert begun.wait(60)
        done = command_line.run(
            "--connect", server.endpoint, "doctor", "--for", f"{END_S - 0.7}s", "--json",
            *(word for fault in SHARED for word in ("--ignore", fault)),
        )  # fmt: skip
        publisher.join()
    assert done.returncode == 3, done.stderr
    findings = json.loads(done.stdout)["findings"]
    said = {(each["id"], each["subject"]): each["evidence"] for each in findings}
    assert set(said) == expected, said
