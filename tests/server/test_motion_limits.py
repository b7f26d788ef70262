"""Limits of motion in a server's configuration: for its answers, and for readers of its tree."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes.servers import refused
from tests.support.moving_arm import MS, fill
from tests.support.waiting import wait_until
from zenoh_tf import Estimate, TransformTree
from zenoh_tf_client import TransformClient

pytestmark = pytest.mark.own_server

END_NS = 10**18
AHEAD_NS = END_NS + 30 * MS
CONFIG = """
[motion_limits.base]
max_speed_m_s = 9.0
max_rate_rad_s = 3.0
max_clock_error_s = 0.01

[motion_limits.arm]
max_speed_m_s = 0
max_rate_rad_s = 8.0
max_rate_accel_rad_s2 = 100.0
"""


@pytest.fixture
def config(tmp_path: Path) -> tuple[str, str]:
    path = tmp_path / "server.toml"
    path.write_text(CONFIG)
    return "--config", str(path)


def expected() -> Estimate:
    tree = TransformTree()
    fill(tree, END_NS)
    tree.set_motion_limits("base", max_speed_m_s=9.0, max_rate_rad_s=3.0, max_clock_error_s=0.01)
    limits = {"max_rate_rad_s": 8.0, "max_rate_accel_rad_s2": 100.0}
    tree.set_motion_limits("arm", max_speed_m_s=0.0, **limits)
    return tree.estimate_transform("map", "tool", AHEAD_NS)


def assert_guaranteed(found: Estimate) -> None:
    known = expected()
    assert (found.basis, found.level) == (known.basis, known.level) == ("limits", 0.9)
    assert (found.error_m, found.error_rad) == pytest.approx((known.error_m, known.error_rad))
    assert found.error_m >= 9.0 * (0.03 + 0.01)


def test_queries_shared_reads_and_mirrors_have_them(
    start_sharing: StartServer, config: tuple[str, str]
) -> None:
    server = start_sharing(*config)
    with server.connect() as tf, server.connect(reads="shared") as sharing:
        fill(tf, END_NS)
        assert sharing.stats()["reads_shared"] == 1
        for each in (tf, sharing):
            assert_guaranteed(each.estimate_transform("map", "tool", AHEAD_NS))
            many = each.estimate_transforms("map", "tool", [AHEAD_NS])
            assert many.error_m[0] == pytest.approx(expected().error_m)
        assert sharing.stats()["reads_asked_absent"] == 0
        for interest in (None, [("map", "tool")]):
            with tf.mirror(interest) as m:
                assert_guaranteed(m.estimate_transform("map", "tool", AHEAD_NS))


def test_a_replica_has_those_of_its_primary(
    start_server: StartServer, start_sharing: StartServer, config: tuple[str, str]
) -> None:
    primary = start_server(*config)
    with primary.connect() as tf:
        fill(tf, END_NS)
    replica = start_sharing("--replica-of", primary.endpoint)
    for reads in ("query", "shared"):
        with TransformClient.connect(replica.endpoint, reads=reads) as near:
            wait_until(functools.partial(near.can_transform, "map", "tool"))
            assert_guaranteed(near.estimate_transform("map", "tool", AHEAD_NS))


def test_a_replica_takes_none_of_its_own(config: tuple[str, str]) -> None:
    line = refused("--replica-of", "tcp/127.0.0.1:9", *config)
    assert "has the limits of motion of the primary" in line
