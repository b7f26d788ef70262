"""Replicas whose primary is stopped, killed and started again, and clients whose replica is."""

from __future__ import annotations

import re
import signal
import threading
import time
import urllib.request

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint, free_port
from tests.processes.replicas import DEADLINE_S, seen, step, wait_for_writes
from tests.processes.servers import ServerProcess
from tests.support.threads import beside
from tests.support.waiting import wait_until
from zenoh_tf.errors import ReadOnlyReplica, ServerUnavailable
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
            lambda: near.stats().get("replica_age_s", 9) < 0.5 and near.frames() == [],
            "it does not follow the new server",
        )
        with primary.connect(10) as tf:
            tf.set_transforms_xact(step(1))
            wait_for_writes(tf, near)
        assert seen(near) == 1


def test_replicas_that_name_each_other_return_to_the_primary(
    primary: ServerProcess, start_server: StartServer, start_replica: StartServer
) -> None:
    """Without the primary each goes to the other, whose link stays."""
    second = free_endpoint()
    first = start_replica(primary, flags=("--replica-of", second))
    start_replica(primary, flags=("--replica-of", first.endpoint), endpoint=second)
    with first.connect(10) as near, TransformClient.connect(second) as far:
        primary.kill()
        wait_until(lambda: near.stats()["replica_age_s"] > 5, "it does not age")
        start_server(endpoint=primary.endpoint)
        with primary.connect(10) as tf:
            tf.set_transforms_xact(step(1))
        for each in (near, far):
            wait_until(lambda each=each: "map" in each.frames(), "it is still stale")  # type: ignore[misc]


def lose_the_primary(
    primary: ServerProcess, replica: ServerProcess, near: TransformClient, port: int
) -> None:
    with primary.connect(10) as tf:
        tf.set_transforms_xact(step(7))
        wait_for_writes(tf, near)
    primary.kill()
    for page in ("readyz", "healthz"):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}") as reply:
            assert re.search(rb"^replica, \d+\.\d s old$", reply.read(), re.MULTILINE)
    wait_until(lambda: near.stats()["replica_age_s"] > 0.5, "it does not age")
    ages = []
    for _ in range(5):
        assert seen(near) == 7
        ages.append(near.age_s or 0.0)
        time.sleep(0.05)
    assert ages == sorted(ages)
    assert ages[0] > 0.4
    with pytest.raises(ReadOnlyReplica):
        near.set_transforms_xact(step(8))
    with replica.connect(10) as newcomer:  # it does not need the primary, either
        assert seen(newcomer) == 7


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
    """Its clients and their mirrors continue."""
    with primary.connect(10) as tf, near.mirror() as m:
        tf.set_transforms_xact(step(1))
        wait_for_writes(tf, near)
        replica.kill()
        with pytest.raises(ServerUnavailable):
            seen(near)
        tf.set_transforms_xact(step(2))
        start_replica(primary, endpoint=replica.endpoint)

        def is_back() -> bool:
            try:
                return seen(near) == 2
            except ServerUnavailable:
                return False

        wait_until(is_back, "the client does not find it")
        tf.set_transforms_xact(step(3))
        m.wait_for(tf.last_receipt, DEADLINE_S)
        assert seen(m) == 3  # type: ignore[arg-type]
