"""A site's server gathers the trees of robots, each with a server of its own."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import TransformException
from zenoh_tf.introspection import metric_table
from zenoh_tf_client import TransformClient
from zenoh_tf_server import flags

S = 1_000_000_000
ROBOTS = ("robot1", "robot2")


def link(parent: str, child: str, stamp_s: int, x: float) -> StampedTransform:
    return StampedTransform(parent, child, stamp_s * S, Transform((x, 0, 0)))


def x_of(tf: TransformClient, target: str, source: str) -> float | None:
    """Where `source` is in `target`; None if that is not known."""
    try:
        return float(tf.lookup_transform(target, source).transform.translation[0])
    except TransformException:
        return None


def stats(tf: TransformClient) -> dict[str, Any]:
    return dict(tf.stats())


@pytest.fixture
def robots(start_server: StartServer) -> list[ServerProcess]:
    """Two robots whose frames have the same names."""
    servers = [start_server(tree="main"), start_server(tree="body")]
    for number, server in enumerate(servers, 1):
        with server.connect() as tf:
            tf.set_transform(link("map", "base", 1, number), authority="wheels")
            tf.set_transform(link("base", "camera", 0, 0.5), authority="calibration", static=True)
    return servers


@pytest.fixture
def start_site(start_server: StartServer) -> Callable[..., ServerProcess]:
    def start(robots: list[ServerProcess], *more: str) -> ServerProcess:
        links = [
            word
            for name, robot in zip(ROBOTS, robots, strict=False)
            for word in ("--mirror-of", f"{name}={robot.endpoint}/{robot.tree}")
        ]
        return start_server(*links, "--mirror-shared", "map,world", *more, tree="site")

    return start


def arrived(tf: TransformClient, robot: str, x: float) -> None:
    wait_until(lambda: x_of(tf, "map", f"{robot}/camera") == x, f"{robot} at {x}")


def test_equal_names_become_different_and_shared_ones_stay(
    robots: list[ServerProcess], start_site: Callable[..., ServerProcess]
) -> None:
    site = start_site(robots)
    with site.connect() as tf:
        for number, name in enumerate(ROBOTS, 1):
            arrived(tf, name, number + 0.5)
        assert x_of(tf, "robot1/base", "robot2/base") == 1.0
        expected = {f"{name}/{frame}" for name in ROBOTS for frame in ("base", "camera")}
        assert set(tf.frames()) == {"map", *expected}
        assert tf.frame("robot1/camera").static and not tf.frame("robot1/base").static
        assert tf.frame("robot1/base").authority == "robot1:wheels"
        # What is committed from now on comes too, in order.
        with robots[0].connect() as robot:
            for stamp in range(2, 9):
                robot.set_transform(link("map", "base", stamp, 10.0 * stamp), authority="wheels")
            robot.set_transform(
                link("base", "camera", 0, 0.25), authority="calibration", static=True
            )
        arrived(tf, "robot1", 80.25)
        for stamp in range(1, 9):
            found = tf.lookup_transform("map", "robot1/base", stamp * S)
            assert found.transform.translation[0] == (1.0 if stamp == 1 else 10.0 * stamp)
        # The site's tree is its own.
        tf.set_transform(link("robot2/base", "sticker", 0, 7.0), static=True)
        assert x_of(tf, "map", "sticker") == 9.0
    with robots[1].connect() as robot:
        assert set(robot.frames()) == {"map", "base", "camera"}


def test_the_site_declares_limits_of_motion_itself(
    start_server: StartServer, start_site: Callable[..., ServerProcess], tmp_path: Path
) -> None:
    limits = "max_speed_m_s = {}\nmax_rate_rad_s = 1.0\n"
    files = {"robot": "[motion_limits.base]\n", "site": '[motion_limits."robot1/base"]\n'}
    for (name, table), speed in zip(files.items(), (2.0, 3.0), strict=True):
        (tmp_path / f"{name}.toml").write_text(table + limits.format(speed))
    robot = start_server("--config", str(tmp_path / "robot.toml"), tree="main")
    site = start_site([robot], "--config", str(tmp_path / "site.toml"))
    with robot.connect() as own, site.connect() as tf:
        for stamp in range(1, 5):
            own.set_transform(link("map", "base", stamp, 1.0), authority="wheels")
        wait_until(lambda: tf.can_transform("map", "robot1/base", 4 * S))
        for each, name, error_m in ((own, "base", 0.2), (tf, "robot1/base", 0.3)):
            found = each.estimate_transform("map", name, 4 * S + S // 10)
            assert found.basis == "limits" and found.error_m == pytest.approx(error_m)


def test_no_robot_moves_a_shared_frame_or_harms_another_one(
    robots: list[ServerProcess], start_site: Callable[..., ServerProcess]
) -> None:
    long_name = "n" * 250  # with the prefix it has more bytes than a name may have
    with robots[0].connect() as robot:
        robot.set_transform(link("world", "map", 0, 99.0), authority="wheels", static=True)
        robot.set_transform(link("map", long_name, 1, 1.0), authority="wheels")
        robot.set_transform(link("map", "robot1/arm", 1, 3.0), authority="wheels")
    site = start_site(robots)
    with site.connect() as tf:
        arrived(tf, "robot1", 1.5)
        arrived(tf, "robot2", 2.5)
        wait_until(lambda: x_of(tf, "map", "robot1/arm") == 3.0, "a frame with the prefix already")
        assert tf.frame("map").parent is None
        wait_until(lambda: stats(tf)["robot_refused/robot1"] == 1, "the refusal is counted")
        found = stats(tf)
        assert found["robot_left_out/robot1"] == 1
        assert found["robot_refused/robot2"] == found["robot_left_out/robot2"] == 0
        assert found["robot_stored/robot2"] == found["robot_received/robot2"] == 2
        assert found["robot_connected/robot1"] == 1
        assert found["robot_age_s/robot1"] >= 0
        of_robots = {key.partition("/")[0] for key in found if key.startswith("robot_")}
        assert of_robots == metric_table.FROM_ROBOTS.keys()


def test_a_frozen_robot_holds_nobody_up(
    robots: list[ServerProcess], start_site: Callable[..., ServerProcess]
) -> None:
    site = start_site(robots)
    with site.connect() as tf, robots[1].connect() as second:
        arrived(tf, "robot1", 1.5)
        robots[0].freeze()
        for stamp in range(2, 30):
            second.set_transform(link("map", "base", stamp, stamp), authority="wheels")
        arrived(tf, "robot2", 29.5)
        tf.set_transform(link("map", "own", 1, 4.0))
        assert x_of(tf, "robot1/base", "own") == 3.0
        wait_until(lambda: stats(tf)["robot_connected/robot1"] == 0, "robot1 is silent")
        robots[0].send_signal(signal.SIGCONT)
        with robots[0].connect() as first:
            first.set_transform(link("map", "base", 2, 12.0), authority="wheels")
        arrived(tf, "robot1", 12.5)


def test_a_site_starts_without_its_robots(
    start_site: Callable[..., ServerProcess], start_server: StartServer
) -> None:
    endpoint = free_endpoint()
    site = start_server("--mirror-of", f"robot1={endpoint}", tree="site")
    with site.connect() as tf:
        assert stats(tf)["robot_connected/robot1"] == 0
        with start_server(endpoint=endpoint).connect() as robot:
            robot.set_transform(link("map", "base", 1, 1.0))
            wait_until(lambda: x_of(tf, "robot1/map", "robot1/base") == 1.0, "the robot's frames")


def test_a_site_shows_robots_who_it_is(start_server: StartServer, tmp_path: Path) -> None:
    users, password = tmp_path / "users", tmp_path / "password"
    users.write_text("site:secret\n")
    password.write_text("secret\n")
    for file in (users, password):
        file.chmod(0o600)
    robot = start_server("--users", str(users))
    where = ("--mirror-of", f"robot1={robot.endpoint}")
    stranger = start_server(*where)
    site = start_server(*where, "--user", "site", "--password-file", str(password))
    with site.connect() as tf:
        wait_until(lambda: stats(tf)["robot_connected/robot1"] == 1, "the user may connect")
    with stranger.connect() as tf:
        stranger.wait_for_log("cannot be reached")
        assert stats(tf)["robot_connected/robot1"] == 0


def test_a_tree_that_is_not_there_is_named(
    robots: list[ServerProcess], start_server: StartServer
) -> None:
    site = start_server("--mirror-of", f"robot1={robots[0].endpoint}/other", tree="site")
    site.wait_for_log("the server of robot 'robot1'")
    assert "robot 'robot1' has not sent its tree yet" in site.log


def test_a_site_does_not_gather_itself(start_server: StartServer) -> None:
    endpoint = free_endpoint()
    site = start_server("--mirror-of", f"me={endpoint}/main", endpoint=endpoint)
    with site.connect() as tf:
        tf.set_transform(link("map", "base", 1, 1.0))
        site.wait_for_log("leads to this server itself")
        assert set(tf.frames()) == {"map", "base"}


def test_a_link_names_an_endpoint_and_a_tree() -> None:
    texts = (
        "r1=tcp/[::1]:7447/main,max-frames=500",
        "r2=tls/host:1/a/b",
        "r3=tcp/h:1,max-frames=7",
        "r4=tcp/h:1",
    )
    line = [word for text in texts for word in ("--mirror-of", text)]
    links = flags.parse(line).mirror_of
    assert [(each.name, each.endpoint, each.tree, each.share.max_frames) for each in links] == [
        ("r1", "tcp/[::1]:7447", "main", 500),
        ("r2", "tls/host:1", "a/b", None),
        ("r3", "tcp/h:1", "main", 7),
        ("r4", "tcp/h:1", "main", None),
    ]
