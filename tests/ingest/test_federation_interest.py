"""A site takes only some paths of a robot's tree, at a rate."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.support.small_robot import link
from tests.support.waiting import wait_until
from zenoh_tf_client import TransformClient
from zenoh_tf_server import flags

S = 1_000_000_000


def build(robot: TransformClient) -> None:
    """map -> odom -> base -> arm -> gripper, and a camera on the base, below the root `earth`."""
    robot.set_transforms_xact(
        [
            link("earth", "map", S, 100.0),
            link("map", "odom", S, 1.0),
            link("odom", "base", S, 2.0),
            link("arm", "gripper", S, 8.0),
            link("base", "camera", S, 16.0),
        ],
        authority="wheels",
    )
    robot.set_transform(link("base", "arm", 0, 4.0), authority="calibration", static=True)


def x_of(tf: TransformClient, target: str, source: str, stamp_ns: int | None = None) -> float:
    found = tf.lookup_transform(target, source, stamp_ns)
    return float(found.transform.translation[0])


def stats(tf: TransformClient, field: str) -> float:
    return float(tf.stats()[f"robot_{field}/r"])


def test_only_the_paths_between_the_named_frames_are_taken(
    server: ServerProcess, start_server: StartServer
) -> None:
    with server.connect() as robot:
        build(robot)
        for stamp in range(2, 6):
            robot.set_transform(link("map", "odom", stamp * S, stamp), authority="wheels")
        site = start_server(
            *("--mirror-of", f"r={server.endpoint},frames=map:base:gripper"),
            *("--mirror-shared", "map"),
        )
        with site.connect() as tf:
            wait_until(lambda: tf.can_transform("map", "r/gripper"), "the path")
            assert set(tf.frames()) == {"map", "r/odom", "r/base", "r/arm", "r/gripper"}
            # Histories too; what is not on a path never comes.
            for stamp in range(1, 6):
                assert x_of(tf, "map", "r/odom", stamp * S) == stamp
            assert tf.frame("r/arm").static and tf.frame("r/arm").authority == "r:calibration"
            assert x_of(tf, "map", "r/gripper") == 1 + 2 + 4 + 8  # at their latest common time
            for stamp in range(6, 50):
                robot.set_transforms_xact(
                    [link("map", "odom", stamp * S, stamp), link("base", "camera", stamp * S, 0)],
                    authority="wheels",
                )
            wait_until(lambda: x_of(tf, "map", "r/odom") == 49, "the newest sample")
            assert "r/camera" not in tf.frames()
            assert stats(tf, "left_out") == 1  # what the robot says of `map`
            assert stats(tf, "refused") == 0
            wait_until(
                lambda: stats(tf, "received") == stats(tf, "stored") + 1,
                lambda: str({k: v for k, v in tf.stats().items() if k.startswith("robot")}),
            )
            # The path follows the robot's topology.
            robot.set_transform(link("camera", "gripper", 60 * S, 32.0), authority="wheels")
            robot.set_transform(link("base", "camera", 60 * S, 16.0), authority="wheels")
            wait_until(lambda: "r/camera" in tf.frames(), "the new path")
            assert tf.frame("r/camera").parent == "r/base"
            assert tf.frame("r/gripper").parent == "r/camera"


def test_a_rate_thins_what_comes(server: ServerProcess, start_server: StartServer) -> None:
    with server.connect() as robot:
        build(robot)
        site = start_server(
            *("--mirror-of", f"r={server.endpoint},frames=map:base,rate=5"),
            *("--mirror-shared", "map"),
        )
        with site.connect() as tf:
            wait_until(lambda: tf.can_transform("map", "r/base"), "the path")
            begin_s, stamp = time.monotonic(), 2
            while time.monotonic() < begin_s + 2:
                robot.set_transform(link("map", "odom", stamp * S, stamp), authority="wheels")
                stamp += 1
            sent_s = time.monotonic() - begin_s
            wait_until(lambda: x_of(tf, "map", "r/odom") == stamp - 1, "the newest sample")
            # At most one sample of the only frame that moves in each period, and the first copy.
            assert stats(tf, "received") <= (sent_s + 1) * 5 + 4
            assert stamp > 4 * stats(tf, "received")  # otherwise this tests nothing
            assert stats(tf, "connected") == 1


def test_all_frames_can_be_thinned(server: ServerProcess, start_server: StartServer) -> None:
    with server.connect() as robot:
        build(robot)
        site = start_server("--mirror-of", f"r={server.endpoint},rate=20")
        with site.connect() as tf:
            wait_until(lambda: tf.can_transform("r/earth", "r/camera"), "everything")
            robot.set_transform(link("map", "odom", 2 * S, 7.0), authority="wheels")
            wait_until(lambda: x_of(tf, "r/map", "r/odom") == 7, "a change")


def test_a_robot_with_an_interest_comes_back(start_server: StartServer) -> None:
    server = start_server()
    with server.connect() as robot:
        build(robot)
    site = start_server("--mirror-of", f"r={server.endpoint},frames=map:base,rate=20")
    with site.connect() as tf:
        wait_until(lambda: tf.can_transform("r/map", "r/base"), "the path")
        server.kill()
        wait_until(lambda: stats(tf, "connected") == 0, "it is away")
        with start_server(endpoint=server.endpoint).connect() as robot:
            build(robot)
            robot.set_transform(link("map", "odom", 3 * S, 9.0), authority="wheels")
            wait_until(lambda: x_of(tf, "r/map", "r/odom") == 9, "the new server's tree")
            wait_until(lambda: stats(tf, "connected") == 1, "it is back")


def test_options_stand_in_any_order_and_in_the_file(tmp_path: Path) -> None:
    one, other = (
        flags.parse(["--mirror-of", f"a=tcp/h:1/t,{options}"]).mirror_of[0]
        for options in (
            "frames=map:base:gripper,rate=10,max-frames=5",
            "max-frames=5,rate=10,frames=map:base:gripper",
        )
    )
    assert one == other and one.share.max_frames == 5 and one.tree == "t"
    interest = one.share.interest
    assert interest.pairs == (("base", "gripper"), ("base", "map"))
    assert interest.period_ns == 100_000_000 and interest.delay_ns == 0
    file = tmp_path / "server.toml"
    file.write_text('mirror-of = ["a=tcp/h:1/t,frames=map:base:gripper,rate=10,max-frames=5"]\n')
    assert flags.parse(["--config", str(file)]).mirror_of == [one]
    file.write_text('mirror-of = ["a=tcp/h:1,rate=often"]\n')
    with pytest.raises(SystemExit):
        flags.parse(["--config", str(file)])
