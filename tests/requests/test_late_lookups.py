"""Lookups by query that a link made fail or wait, which its record counts."""

from __future__ import annotations

import contextlib
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import ExtrapolationException, StampedTransform, Transform, TransformException
from zenoh_tf_client import TransformClient

MS = 10**6
S = 10**9

Counts = tuple[int, int, int]


def put(tf: TransformClient, child: str, *stamps_ns: int, parent: str = "map") -> None:
    for stamp_ns in stamps_ns:
        tf.set_transform(StampedTransform(parent, child, stamp_ns, Transform()))


def counts(tf: TransformClient, name: str = "odom") -> Counts:
    """Failures, waits, and by how much all of them were too early, in ns."""
    frame = tf.frame(name)
    return frame.late_failures, frame.late_waits, frame.late_ns


def fails(tf: TransformClient, stamp_ns: int, timeout_s: float = 0.0) -> None:
    with pytest.raises(ExtrapolationException):
        tf.lookup_transform("map", "odom", stamp_ns, timeout_s=timeout_s)


def past_ns() -> int:
    """A time of samples that are older than all that is asked for."""
    return time.time_ns() - 60 * S


def test_a_lookup_that_fails_counts_once_for_the_link_without_a_sample(
    client: TransformClient,
) -> None:
    newest_ns = past_ns()
    put(client, "odom", newest_ns - S, newest_ns)
    put(client, "base", newest_ns - S, newest_ns + S, parent="odom")
    client.lookup_transform("map", "base", newest_ns)
    client.lookup_transform("map", "base")
    assert counts(client) == (0, 0, 0)
    fails(client, newest_ns + 85 * MS)
    assert counts(client) == (1, 0, 85 * MS)
    with client.batch() as batch:
        handles = [
            batch.lookup_transform("map", "base", newest_ns + ms * MS) for ms in (-1, 100, 200)
        ]
    assert [handle.exception() is None for handle in handles] == [True, False, False]
    assert counts(client) == (3, 0, 385 * MS)
    found = client.lookup_transforms("map", "base", newest_ns + np.array([0, 10, 20]) * MS)
    assert np.count_nonzero(found.status) == 2
    assert counts(client) == (5, 0, 415 * MS)
    assert counts(client, "base") == (0, 0, 0)


def test_the_link_counts_whose_newest_sample_is_the_oldest(client: TransformClient) -> None:
    """An error names the first link that the walk came to, also one above both frames."""
    newest_ns = past_ns()
    put(client, "odom", newest_ns - S, newest_ns)
    put(client, "base", newest_ns - S, newest_ns + 50 * MS, parent="odom")
    put(client, "arm", newest_ns - S, newest_ns + 70 * MS, parent="base")
    for target, source, late, late_ms in (
        *(("map", "arm", "odom", 100), ("arm", "map", "odom", 100)),
        *(("odom", "arm", "base", 50), ("base", "arm", "arm", 30)),
    ):
        before = counts(client, late)
        with pytest.raises(ExtrapolationException):
            client.lookup_transform(target, source, newest_ns + 100 * MS)
        failures, _, late_ns = before
        assert counts(client, late) == (failures + 1, 0, late_ns + late_ms * MS)
    client.remove_frame("arm")
    put(client, "arm", newest_ns, parent="base")
    assert counts(client, "arm") == (0, 0, 0)


def test_a_link_of_one_sample_is_late_too(client: TransformClient) -> None:
    newest_ns = past_ns()
    put(client, "odom", newest_ns)
    fails(client, newest_ns + 3 * MS)
    fails(client, newest_ns - 3 * MS)
    assert counts(client) == (1, 0, 3 * MS)


def test_stamps_that_no_link_can_have_do_not_count(client: TransformClient) -> None:
    now_ns = time.time_ns()
    put(client, "odom", now_ns - 11 * S, now_ns - 10 * S)
    for stamp_ns in (now_ns // S, now_ns - 20 * S, now_ns * 5, now_ns + 5 * S, now_ns + S):
        fails(client, stamp_ns)
    put(client, "sim", 10 * S, 20 * S)
    for stamp_ns in (now_ns, 31 * S, 2**63 - 1, -(2**63) + 1, 0):
        with pytest.raises(ExtrapolationException):
            client.lookup_transform("map", "sim", stamp_ns)
    with pytest.raises(TransformException):
        client.lookup_transform("map", "nowhere", now_ns)
    assert counts(client) == counts(client, "sim") == (0, 0, 0)
    # Simulated time is as good as any.
    with pytest.raises(ExtrapolationException):
        client.lookup_transform("map", "sim", 29 * S)
    assert counts(client, "sim") == (1, 0, 9 * S)


def test_a_lookup_that_waits_counts_once_it_has_its_answer(client: TransformClient) -> None:
    newest_ns = past_ns()
    put(client, "odom", newest_ns - S, newest_ns)
    put(client, "base", newest_ns - S, newest_ns - 100 * MS, parent="odom")
    ask = ("map", "base", newest_ns + 300 * MS)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(client.lookup_transform, *ask, timeout_s=60.0)
        wait_until(lambda: client.stats()["waiters"] == 1)
        put(client, "odom", newest_ns + S)
        put(client, "base", newest_ns + S, parent="odom")
        asked.result()
    # It waited for both, and for the wheels longer.
    assert (counts(client), counts(client, "base")) == ((0, 0, 0), (0, 1, 400 * MS))
    # One that finds its answer at once, or never gets it.
    client.lookup_transform(*ask, timeout_s=60.0)
    assert counts(client, "base") == (0, 1, 400 * MS)
    fails(client, newest_ns + S + 40 * MS, timeout_s=0.01)
    assert counts(client) == (1, 0, 40 * MS)


def test_a_lookup_that_waits_for_a_frame_does_not_count(client: TransformClient) -> None:
    newest_ns = past_ns()
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(client.lookup_transform, "map", "odom", newest_ns, timeout_s=60.0)
        wait_until(lambda: client.stats()["waiters"] == 1)
        put(client, "odom", newest_ns)
        asked.result()
    assert counts(client) == (0, 0, 0)


@pytest.mark.own_server
def test_lookups_in_memory_are_not_counted_but_see_the_counts(server: ServerProcess) -> None:
    newest_ns = past_ns()
    with server.connect() as tf, server.connect(reads="shared") as local:
        put(tf, "odom", newest_ns)
        if not local.stats()["reads_shared"]:
            pytest.skip("this host does not share memory")
        fails(local, newest_ns + MS)
        assert counts(tf) == counts(local) == (0, 0, 0)
        fails(tf, newest_ns + MS)
        assert counts(tf) == counts(local) == (1, 0, MS)


@pytest.mark.own_server
def test_many_threads_lose_no_count(server: ServerProcess) -> None:
    newest_ns = past_ns()
    with contextlib.ExitStack() as stack, ThreadPoolExecutor(4) as pool:
        clients = [stack.enter_context(server.connect()) for _ in range(4)]
        put(clients[0], "odom", newest_ns)
        stamps_ns = np.full(500, newest_ns + 2 * MS)
        ask = [
            pool.submit(each.lookup_transforms, "map", "odom", stamps_ns)
            for each in clients
            for _ in range(5)
        ]
        assert all(asked.result().status.all() for asked in ask)
        assert counts(clients[0]) == (10_000, 0, 20_000 * MS)
