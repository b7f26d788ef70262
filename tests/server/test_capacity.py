"""What the server says of how many robots its limits have room for."""

from __future__ import annotations

import re
import resource
from dataclasses import replace

import pytest

from tests.conftest import StartServer
from zenoh_tf_server.capacity import Capacity, capacity
from zenoh_tf_server.limits import Limits

_MANY_FILES = 1 << 20


def test_the_default_limits_have_room_for_a_thousand_robots() -> None:
    assert capacity(Limits(), 10.0, 4, _MANY_FILES).robots >= 1000


@pytest.mark.parametrize(
    ("name", "value", "robots"),
    [
        ("connections", 10, 10),
        ("frames", 600, 10),
        ("interests", 10, 10),
        ("interest_frames", 600, 10),
        ("pending_queries", 10, 10),
        ("memory", 10 * 60 * 64 * 68 * 2, 10),  # a ring of 64 samples, and those before it
        ("put_queues_bytes", 10 * 6 * 2000, 10),  # 24 messages a second wait for a quarter of one
    ],
)
def test_the_least_limit_is_named(name: str, value: int, robots: int) -> None:
    limits = replace(Limits(), **{name: value})
    assert capacity(limits, 10.0, 4, _MANY_FILES) == Capacity(robots, name)


def test_open_files_are_a_limit() -> None:
    assert capacity(Limits(), 10.0, 4, 104) == Capacity(40, "open_files")


def test_a_history_has_no_more_samples_than_its_limit() -> None:
    few = replace(Limits(), samples_per_frame=64, memory=1 << 20)
    assert capacity(few, 10.0, 4, _MANY_FILES) == capacity(few, 1000.0, 4, _MANY_FILES)


def test_a_server_says_it_and_raises_its_own_open_files(start_server: StartServer) -> None:
    flags = ("--limit", "connections=7", "--limit", "put_wait_ms=250", "--log-level", "info")
    server = start_server(*flags)
    server.wait_for_log("the limits have room for")
    assert re.search(r": 7 at 4 Hz \(connections first\) or 7 at 100 Hz", server.log)
    soft, hard = resource.prlimit(server.process.pid, resource.RLIMIT_NOFILE)
    assert soft == hard or soft >= 1 << 16
