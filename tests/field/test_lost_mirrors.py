"""Robots whose servers are gone, and whose last poses are still answers: RobotecAI/rai#506 and
carzum/termviz#68; and robots that strangers pretend to be."""

from __future__ import annotations

import json
import time

import pytest
import zenoh

from tests.conftest import StartServer
from tests.support.command_line import run
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf._net import keys, zenoh_config

#: Long after any real clock's zero, and a simulation's time.
CLOCKS = {"real": time.time_ns, "simulated": lambda: 12_500_000_000}


def link(parent: str, child: str, stamp_ns: int, x: float = 0.0) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0)))


@pytest.mark.parametrize(("clock", "name"), [("real", "r1"), ("simulated", "tug-7")])
def test_the_last_pose_of_a_robot_that_is_gone(
    start_server: StartServer, clock: str, name: str
) -> None:
    robot = start_server()
    site = start_server("--mirror-of", f"{name}={robot.endpoint}", "--mirror-shared", "map")
    with robot.connect() as own:
        own.set_transform(link("map", "base_link", CLOCKS[clock](), 3.0), authority="amcl")
    with site.connect() as tf, tf.mirror() as mirror:
        base = f"{name}/base_link"
        assert tf.can_transform("map", base, timeout_s=100)
        assert "disconnected" not in str(tf.explain("map", base))
        (amcl,) = tf.authorities()
        assert (amcl.name, amcl.mirror_lost_s) == (f"{name}:amcl", None)
        robot.kill()
        wait_until(lambda: tf.authorities()[0].mirror_lost_s, "its loss is not noticed")
        found = tf.explain("map", base)
        assert found.possible
        assert f"The mirror of {name} is disconnected for " in str(found)
        assert tf.lookup_transform("map", base).transform.translation[0] == 3
        result = run("--connect", site.endpoint, "doctor", "--for", "0.1s", "--json")
        (finding,) = [
            each for each in json.loads(result.stdout)["findings"] if each["id"] == "TF108"
        ]
        assert finding["subject"] == base
        assert f"the mirror of {name} is disconnected for " in finding["evidence"]
        site.wait_for_log(f"robot {name!r}: its server is not heard for ")
        assert site.log.count("is not heard") == 1
        assert mirror.synced
        # Back on the same endpoint, it is heard again.
        again = start_server(endpoint=robot.endpoint)
        with again.connect() as own:
            own.set_transform(link("map", "base_link", CLOCKS[clock](), 4.0), authority="amcl")
        wait_until(lambda: tf.authorities()[0].mirror_lost_s is None, "its return is not noticed")
        assert "disconnected" not in str(tf.explain("map", base))
        site.wait_for_log(f"robot {name!r}: its server is heard again after ")


@pytest.mark.parametrize("stamp_ns", [5, 1_700_000_000_000_000_000])
def test_a_mirror_whose_server_is_gone(start_server: StartServer, stamp_ns: int) -> None:
    server = start_server()
    with server.connect() as tf:
        tf.set_transform(link("map", "base", stamp_ns))
        with tf.mirror() as mirror:
            assert "disconnected" not in str(mirror.explain("map", "base"))
            server.kill()
            wait_until(lambda: mirror.age_s > 2.5)
            found = mirror.explain("map", "base")
            assert found.possible
            assert "The mirror is disconnected from its server for " in str(found)


@pytest.mark.parametrize(
    ("name", "frames"), [("crane", ("hook", "arm")), ("lift", ("fork", "mast"))]
)
def test_a_robot_that_is_found_takes_no_frames_of_others(
    start_server: StartServer, name: str, frames: tuple[str, str]
) -> None:
    site = start_server("--mirror-of", "robots/*", "--mirror-shared", "map", tree="site")
    static, dynamic = (f"{name}/{frame}" for frame in frames)
    with site.connect() as tf:
        tf.set_transform(link("map", static, 0, 1.0), authority="ops", static=True)
        tf.set_transform(link("map", dynamic, 1, 1.0), authority="ops")
        robot = start_server(
            "--connect", site.endpoint, tree=f"robots/{name}", endpoint=site.endpoint
        )
        with robot.connect() as own:
            own.set_transforms_xact(
                [link("map", frame, 2, 9.0) for frame in (*frames, "cab")], authority="plc"
            )
        assert tf.can_transform("map", f"{name}/cab", timeout_s=100)
        for frame in (static, dynamic):
            assert tf.frame(frame).authority == "ops"
            assert tf.lookup_transform("map", frame).transform.translation[0] == 1
        site.wait_for_log(f"cannot store frame '{name}/")
        (plc,) = [each for each in tf.authorities() if each.name == f"{name}:plc"]
        assert plc.refused == 2
        assert "'ops' has written it" in (plc.last_refusal or "")


@pytest.mark.parametrize(("first", "second"), [("fleetA/", "fleetB/"), ("north/", "south/")])
def test_two_fleets_with_one_name(start_server: StartServer, first: str, second: str) -> None:
    patterns = ("--mirror-of", f"{first}*", "--mirror-of", f"{second}*")
    site = start_server(*patterns, "--mirror-shared", "map", tree="site")
    with site.connect() as tf:
        for fleet, frame in ((first, "base"), (second, "gripper")):
            tree = f"{fleet}r1"
            robot = start_server("--connect", site.endpoint, tree=tree, endpoint=site.endpoint)
            with robot.connect() as own:
                own.set_transform(link("map", frame, 1))
            if fleet == first:
                assert tf.can_transform("map", "r1/base", timeout_s=100)
        site.wait_for_log(f"tree '{second}r1' is left out: tree '{first}r1' is called 'r1' already")
        assert sorted(tf.frames()) == ["map", "r1/base"]
        assert site.log.count("is left out") == 1


@pytest.mark.parametrize("tokens", [40, 300])
def test_tokens_with_nobody_behind_keep_no_robot_out(
    start_server: StartServer, tokens: int
) -> None:
    site = start_server("--mirror-of", "robots/*", "--limit", "robots=8", tree="site")
    with zenoh.open(zenoh_config.client([site.endpoint], 5.0)) as opened, site.connect() as tf:
        strangers = [
            opened.liveliness().declare_token(keys.server(f"robots/x{number}", "1"))
            for number in range(tokens)
        ]
        wait_until(lambda: any(name.endswith("/x0") for name in tf.stats()))
        for token in strangers[:-1]:
            token.undeclare()
        robot = start_server(
            "--connect", site.endpoint, tree="robots/honest", endpoint=site.endpoint
        )
        with robot.connect() as own:
            own.set_transform(link("map", "base", 1))
        assert tf.can_transform("honest/map", "honest/base", timeout_s=100)

        def robots() -> set[str]:
            return {key.partition("/")[2] for key in tf.stats() if key.startswith("robot_frames")}

        wait_until(lambda: robots() <= {"honest", f"x{tokens - 1}"}, robots)
