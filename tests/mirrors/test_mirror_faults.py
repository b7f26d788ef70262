"""Mirrors that are stopped, cut off or too slow, and servers that are restarted: nobody else is
harmed, and each mirror is right again soon."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from tests.conftest import StartServer
from tests.processes.mirror_process import MirrorProcess, versions
from tests.processes.servers import ServerProcess
from tests.processes.tcp_proxy import TcpProxy
from tests.support.threads import beside
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import ServerUnavailable, TransformException
from zenoh_tf_client import Mirror, TransformClient

DEADLINE_S = 40.0
#: The frames of the load's commits, all of which have the same stamp.
FRAMES = [f"frame{i}" for i in range(60)]
#: What a mirror has: those on the paths of pairs, or None for all.
PAIRS = [("map", name) for name in FRAMES]
Pairs = list[tuple[str, str]] | None


def step(stamp: int) -> list[StampedTransform]:
    return [StampedTransform("map", name, stamp, Transform((stamp, 0, 0))) for name in FRAMES]


@contextmanager
def load(server: ServerProcess) -> Iterator[list[int]]:
    """Commits of all frames, one after another; yields the stamps that are there."""
    with server.connect(20) as tf:
        tf.set_transforms_xact(step(1))  # mirrors that begin from now on have it
        stamps = [0, 1]

        def write(ending: threading.Event) -> None:
            while not ending.wait(0.002):
                tf.set_transforms_xact(step(stamps[-1] + 1))
                stamps.append(stamps[-1] + 1)

        with beside(write):
            yield stamps


def is_equal(server: ServerProcess, found: dict[str, int]) -> bool:
    with server.connect(20) as tf:
        return found == {name: tf.frame(name).version for name in tf.frames()}


def check_whole(mirror: Mirror) -> int:
    """All frames must be of one commit; return its stamp."""
    found = mirror.lookup_latest_transforms_xact([("map", name) for name in FRAMES])
    stamps = {one.stamp_ns for one in found}
    assert len(stamps) == 1, stamps
    return stamps.pop()


@pytest.mark.parametrize(
    ("fault", "pairs"),
    [("cut", None), ("reset", None), ("hold", None), ("cut", PAIRS), ("hold", PAIRS)],
    ids=["cut", "reset", "hold", "cut-pairs", "hold-pairs"],
)
def test_a_mirror_behind_a_broken_link(
    server: ServerProcess, client: TransformClient, fault: str, pairs: Pairs
) -> None:
    pairs = pairs and [*pairs, ("map", "later")]
    pair = ("map", FRAMES[0])
    with (
        TcpProxy(server.endpoint) as proxy,
        TransformClient.connect(proxy.endpoint, timeout_s=1, reads="query") as tf,
    ):
        with load(server) as stamps:
            m = tf.mirror(pairs)
            instance = m.instance
            for round_ in range(2):
                before = check_whole(m)
                if fault == "hold":
                    proxy.hold()
                    wait_until(lambda: m.age_s > 0.6, "it does not age")
                    assert check_whole(m) >= before
                    with pytest.raises(ServerUnavailable):
                        m.lookup_latest_transform(*pair, max_age_s=0.5)
                    proxy.release()
                else:
                    getattr(proxy, fault)()
                at = stamps[-1]
                wait_until(lambda at=at: check_whole(m) > at, "it does not continue")  # type: ignore[misc]
                assert m.instance == instance
                client.set_transform(StampedTransform("map", "later", round_, Transform()))
                m.wait_for(client.last_receipt, DEADLINE_S)
                assert m.lookup_transform("map", "later").stamp_ns == round_
            wait_until(lambda: m.age_s < 1, "it stays old")
        client.set_transform(StampedTransform("map", "later", 9, Transform()))
        m.wait_for(client.last_receipt, DEADLINE_S)
        here, there = m.sample(*pair, stamps), client.sample(*pair, stamps)
        assert here.status.tolist() == there.status.tolist()
        assert np.array_equal(here.translations, there.translations, equal_nan=True)


@pytest.mark.slow
def test_a_mirror_that_is_too_slow(start_server: StartServer) -> None:
    """It cannot apply the stream as fast as it comes; others are not held up."""
    server = start_server("--limit", "stream_bytes=1000000")
    with server.connect(20) as tf:
        tf.set_transforms_xact(step(1))
        with tf.mirror() as other, MirrorProcess(server.endpoint, "0.03") as slow:
            with load(server) as stamps:
                for _ in range(20):
                    at = stamps[-1]
                    wait_until(lambda at=at: check_whole(other) > at, "held up")  # type: ignore[misc]
                    time.sleep(0.1)
                assert slow.state()["seq"] > 0
            wait_until(lambda: is_equal(server, slow.state()["versions"]), "it does not catch up")


@pytest.mark.parametrize("pairs", [None, PAIRS], ids=["all", "pairs"])
def test_a_restarted_server(start_server: StartServer, pairs: Pairs) -> None:
    """The old state is served, with a growing age, until there is a copy of the new server's."""
    first = start_server()
    with first.connect(20) as tf, tf.mirror(pairs) as m:
        tf.set_transforms_xact(step(7))
        m.wait_for()
        first.kill()
        wait_until(lambda: m.age_s > 0.5, "it does not age")
        assert check_whole(m) == 7
        old = m.instance
        second = start_server(endpoint=first.endpoint)
        assert set(m.frames()) in ({"map", *FRAMES}, set())
        with second.connect(20) as other:
            other.set_transforms_xact(step(1))
            wait_until(lambda: m.instance != old, "it does not follow the new server")
            m.wait_for(other.last_receipt, DEADLINE_S)
            assert check_whole(m) == 1
            other.set_transforms_xact(step(2))
            m.wait_for(other.last_receipt, DEADLINE_S)
            assert check_whole(m) == 2
            wait_until(lambda: m.age_s < 5, "it stays old")
            assert sorted(m.frames()) == sorted(other.frames())


def test_names_beyond_what_the_tree_holds(start_server: StartServer) -> None:
    """Names that are added and removed use up the ids of a mirror's tree: it restarts."""
    server = start_server("--limit", "frames=64")
    with server.connect(20) as tf, tf.mirror() as m:
        for round_ in range(400):
            name = f"visitor{round_}"
            tf.set_transform(StampedTransform("map", name, 1, Transform()))
            m.wait_for(timeout_s=DEADLINE_S)
            assert name in m.frames()
            tf.remove_frame(name)
        m.wait_for(timeout_s=DEADLINE_S)
        assert m.frames() == ["map"]
        assert m._feed.snapshots > 1
        assert versions(m) == {"map": tf.frame("map").version}


def test_listeners_end_with_all_commits(server: ServerProcess) -> None:
    """Whatever a busy machine drops is repaired, without further commits."""
    with server.connect(20) as tf:
        mirrors = [server.connect(20).mirror() for _ in range(6)]
        sensors = [tf.broadcaster(f"sensor{i}") for i in range(3)]
        for stamp in range(1, 500):
            for i, sensor in enumerate(sensors):
                sensor.send(
                    [StampedTransform("map", f"{i}/{j}", stamp, Transform()) for j in range(50)]
                )

        def is_there() -> bool:
            try:
                return all(tf.frame(f"{i}/49").newest_stamp_ns == 499 for i in range(3))
            except TransformException:
                return False

        wait_until(is_there, "the puts are not applied")
        expected = {name: tf.frame(name).version for name in tf.frames()}
        for m in mirrors:
            wait_until(lambda m=m: versions(m) == expected, "commits are missing")  # type: ignore[misc]
            m._connection.close()


def test_subscribing_again_ends_no_mirror(server: ServerProcess) -> None:
    """The thread that listens must find the new subscriber when the old one is undeclared."""
    with server.connect(20) as tf, tf.mirror() as m:
        for _ in range(100):
            m._feed._subscribe_again()
            assert m.age_s < DEADLINE_S  # infinite once it is closed
        tf.set_transforms_xact(step(5))
        m.wait_for(timeout_s=DEADLINE_S)
        assert check_whole(m) == 5
