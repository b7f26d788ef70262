"""A site finds the robots on its network by their servers' liveliness tokens."""

from __future__ import annotations

import pytest
import zenoh

from tests.conftest import StartServer
from tests.ingest.test_federation import arrived, link, stats
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf_server.federation.settings import RobotPattern


def test_robots_are_found_when_they_come_and_followed_when_they_return(
    start_server: StartServer,
) -> None:
    site = start_server(
        *("--mirror-of", "robots/*,frames=map:camera", "--mirror-shared", "map"), tree="site"
    )

    def robot(name: str) -> ServerProcess:
        return start_server("--connect", site.endpoint, tree=name, endpoint=site.endpoint)

    def moved(server: ServerProcess, stamp_s: int, x: float) -> None:
        with server.connect() as tf:
            tf.set_transform(link("map", "base", stamp_s, x), authority="wheels")
            tf.set_transform(link("base", "camera", 0, 0.5), authority="mount", static=True)
            tf.set_transform(link("base", "lamp", 0, 0.5), authority="mount", static=True)

    robots = {name: robot(f"robots/{name}") for name in ("r1", "r2")}
    other = robot("depot")
    for number, server in enumerate((*robots.values(), other), 1):
        moved(server, 1, number)
    with site.connect() as tf:
        arrived(tf, "r1", 1.5)
        arrived(tf, "r2", 2.5)
        assert set(tf.frames()) == {"map", "r1/base", "r1/camera", "r2/base", "r2/camera"}
        assert stats(tf)["robot_connected/r1"] == 1
        robots["r1"].kill()
        wait_until(lambda: stats(tf)["robot_connected/r1"] == 0, "r1 is away")
        moved(robots["r2"], 2, 20.0)
        arrived(tf, "r2", 20.5)
        moved(robot("robots/r1"), 3, 30.0)
        arrived(tf, "r1", 30.5)


def test_tokens_of_anyone_take_no_more_than_the_limit(start_server: StartServer) -> None:
    site = start_server("--mirror-of", "*", "--limit", "robots=3", tree="site")
    config = zenoh_config.client([site.endpoint], 5.0)
    with zenoh.open(config) as opened, site.connect() as tf:
        names = [*(f"r{number}" for number in range(10)), "a/b", "a=b", "site"]
        tokens = [opened.liveliness().declare_token(keys.server(name, "x")) for name in names]
        tokens.append(opened.liveliness().declare_token("tf/v1/%zz/server/x"))
        site.wait_for_log("is left out")
        found = {key.partition("/")[2] for key in stats(tf) if key.startswith("robot_connected")}
        assert len(found) == 3
        assert found <= {*names}
        del tokens


@pytest.mark.parametrize(
    ("pattern", "tree", "robot"),
    [
        (RobotPattern("robots/", ""), "robots/r1", "r1"),
        (RobotPattern("", "-arm"), "left-arm", "left"),
        (RobotPattern("", ""), "r1", "r1"),
        (RobotPattern("robots/", ""), "robots/", None),
        (RobotPattern("robots/", ""), "robots/a/b", None),
        (RobotPattern("robots/", ""), "robot1", None),
        (RobotPattern("aba", "ba"), "aba", None),
    ],
)
def test_the_star_is_the_robots_name(pattern: RobotPattern, tree: str, robot: str | None) -> None:
    assert pattern.robot_of(tree) == robot
