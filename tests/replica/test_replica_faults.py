"""Replicas whose primary is stopped, killed and started again, and clients whose replica is."""

from __future__ import annotations

import re
import signal
import threading
import time
import urllib.request

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_port
from tests.processes.replicas import reads_near, seen, step
from tests.processes.servers import ServerProcess
from tests.support.threads import beside
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import OutcomeUnknown, ServerUnavailable
from zenoh_tf_client import TransformClient

pytestmark = pytest.mark.slow

# --- the primary goes and comes


def test_reads_go_on_without_the_primary(
    primary: ServerProcess, start_server: StartServer, start_replica: StartServer
) -> None:
    port = free_port()
    replica = start_replica(primary, flags=("--metrics", f"127.0.0.1:{port}"))
    with replica.connect(10) as near:
        lose_the_primary(primary, replica, near, port)
        start_server(endpoint=primary.endpoint)
        wait_until(
            lambda: near.stats().get("replica_age_s", 9) < 0.5, "it does not follow the new server"
        )
        assert near.frames() == []
        near.set_transforms_xact(step(1))
        assert seen(near) == 1
        assert reads_near(near)


def lose_the_primary(
    primary: ServerProcess, replica: ServerProcess, near: TransformClient, port: int
) -> None:
    near.set_transforms_xact(step(7))
    assert seen(near) == 7
    primary.kill()
    for page in ("readyz", "healthz"):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}") as reply:
            assert re.search(rb"^replica, \d+\.\d s old$", reply.read(), re.MULTILINE)
    wait_until(lambda: near.stats()["replica_age_s"] > 0.5, "it does not age")
    ages = []
    for _ in range(5):
        assert seen(near) == 7
        ages.append(near.replica_age_s or 0.0)
        time.sleep(0.05)
    assert ages == sorted(ages)
    assert ages[0] > 0.4
    for attempt in range(3):
        with pytest.raises(OutcomeUnknown if attempt == 0 else ServerUnavailable) as refusal:
            near.set_transforms_xact(step(8))
    # The replica says so: the client's own time-out, which comes later, has another message.
    assert "the primary of tree 'main' does not answer: writes fail" in str(refusal.value)
    with replica.connect(10) as newcomer:  # it does not need the primary, either
        assert seen(newcomer) == 7


def test_static_links_are_announced_through_a_replica(
    primary: ServerProcess, near: TransformClient, start_server: StartServer
) -> None:
    broadcaster = near.broadcaster("mount")
    broadcaster.send_static([StampedTransform("base", "camera", 0, Transform((1, 0, 0)))])
    wait_until(lambda: near.can_transform("base", "camera"), "the primary does not get it")
    first = near.instance
    primary.kill()
    assert near.can_transform("base", "camera")
    start_server(endpoint=primary.endpoint)

    def is_back() -> bool:
        return near.can_transform("base", "camera") and near.instance != first

    wait_until(is_back, "the new primary does not get it")


def test_nobody_sees_an_older_state(primary: ServerProcess, replica: ServerProcess) -> None:
    """Also while the primary is stopped, its messages are lost, and a new copy replaces the old."""
    last = [1]

    def read(ending: threading.Event) -> None:
        with replica.connect(20) as tf:
            before = 0
            while not ending.is_set():
                now = seen(tf)
                assert now >= before
                before = now

    def write(ending: threading.Event) -> None:
        with primary.connect(20) as tf:
            while not ending.is_set():
                tf.set_transforms_xact(step(last[0] + 1))
                last[0] += 1

    with primary.connect(20) as tf:
        tf.set_transforms_xact(step(1))
    with replica.connect(20) as tf:
        wait_until(lambda: bool(tf.frames()), "the replica has nothing")
    with beside(read, read, write):
        for _ in range(3):
            replica.freeze()
            time.sleep(0.5)
            replica.send_signal(signal.SIGCONT)
            time.sleep(0.2)
            primary.freeze()
            time.sleep(0.5)
            primary.send_signal(signal.SIGCONT)
            at = last[0]
            wait_until(lambda at=at: last[0] > at + 20, "the writer is held up")  # type: ignore[misc]
    with replica.connect(20) as tf:
        wait_until(lambda: seen(tf) == last[0], "it is not right again")


def test_a_restarted_replica(
    primary: ServerProcess,
    replica: ServerProcess,
    near: TransformClient,
    start_replica: StartServer,
) -> None:
    """Its clients continue, and find it under its new key."""
    near.set_transforms_xact(step(1))
    assert seen(near) == 1
    replica.kill()
    with pytest.raises(ServerUnavailable):
        seen(near)
    with primary.connect(10) as tf:
        tf.set_transforms_xact(step(2))
    start_replica(primary, endpoint=replica.endpoint)

    def is_back() -> bool:
        try:
            return seen(near) == 2 and reads_near(near)
        except ServerUnavailable:
            return False

    wait_until(is_back, "the client does not find it")
    near.set_transforms_xact(step(3))
    assert seen(near) == 3
