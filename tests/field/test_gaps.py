"""Interpolation over times in which nothing was measured: it is said, and can be refused."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.support.command_line import call
from zenoh_tf import StampedTransform, Transform, TransformArray, TransformTree
from zenoh_tf.errors import GapTooLong, InvalidArgumentException
from zenoh_tf.shared_tree import SharedTree
from zenoh_tf_client import AsyncTransformClient

S: Final = 10**9

#: (rate in Hz, start of the gap in s, its length in s, metres per second)
GAPS: Final = ((10, 0.0, 9.0, 10.0), (50, 1_770_000_000.0, 0.8, 0.4), (3, -7.0, 4.0, -1.0))


def fill(
    put: Callable[[list[StampedTransform]], object],
    link: tuple[str, str],
    gap: tuple[float, float, float, float],
) -> tuple[int, int]:
    """Send a second of a link on each side of a gap. Return the stamps around it."""
    rate_hz, begin_s, length_s, speed = gap
    begin, length, step = round(begin_s * S), round(length_s * S), round(S / rate_hz)
    before = [begin - i * step for i in range(int(rate_hz) + 1)]
    after = [begin + length + i * step for i in range(int(rate_hz))]
    put(
        [
            StampedTransform(*link, stamp, Transform((speed * (stamp - begin) / S, 0, 0)))
            for stamp in sorted(before + after)
        ]
    )
    return begin, begin + length


def filled(
    gap: tuple[float, float, float, float], **options: Any
) -> tuple[TransformTree, int, int]:
    tree = TransformTree(**options)
    begin, end = fill(tree.set_transforms_xact, ("map", "base"), gap)
    tree.set_transform(StampedTransform("base", "laser", 0, Transform((0, 0, 1))), static=True)
    return tree, begin, end


@pytest.mark.parametrize("concurrency", ["optimistic", "2pl", "giant"])
@pytest.mark.parametrize("gap", GAPS)
def test_a_gap_is_said_and_can_be_refused(gap: Any, concurrency: str) -> None:
    """ros2/geometry2#154: the pose halfway is as tf2 interpolates it; the answer has the gap, and a
    limit refuses it with the link, the gap and the limit."""
    tree, begin, end = filled(gap, concurrency=concurrency)
    middle = (begin + end) // 2
    answer = tree.lookup_transform("map", "laser", middle)
    assert answer.transform.translation[0] == pytest.approx(gap[3] * gap[2] / 2)
    assert answer.gap_ns == end - begin
    assert pickle.loads(pickle.dumps(answer)).gap_ns == answer.gap_ns
    assert eval(repr(answer)) == answer
    assert tree.lookup_transform("laser", "map", middle).gap_ns == end - begin
    step = round(S / gap[0])
    for measured in (begin, end, begin - step // 2, end + step // 3):
        assert tree.lookup_transform("map", "laser", measured).gap_ns == 0
    with pytest.raises(GapTooLong, match="from 'map' to 'base' has no sample for") as caught:
        tree.lookup_transform("map", "laser", middle, max_gap_s=0.5)
    facts = caught.value
    assert (facts.frame, facts.parent_frame, facts.gap_ns) == ("base", "map", end - begin)
    assert (facts.limit, facts.stamp_ns) == (0.5, middle)
    assert (facts.oldest_stamp_ns, facts.newest_stamp_ns) == (begin, end)
    assert tree.lookup_transform("map", "laser", middle, max_gap_s=gap[2]).gap_ns == end - begin
    assert tree.lookup_transform("map", "laser", end, max_gap_s=0).gap_ns == 0
    full = tree.lookup_transform_full("map", end, "laser", middle, "map")
    assert full.gap_ns == end - begin
    with pytest.raises(GapTooLong):
        tree.lookup_transform_full("map", end, "laser", middle, "map", max_gap_s=0.5)
    for wrong in (-1, float("nan"), "1"):
        with pytest.raises(InvalidArgumentException, match="max_gap_s"):
            tree.lookup_transform("map", "laser", middle, max_gap_s=wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("rows", [3, 100])  # row by row, and in blocks
@pytest.mark.parametrize("gap", GAPS)
def test_gaps_of_many_rows(gap: Any, rows: int) -> None:
    """ros2/geometry2#154, sampled: each row has its own gap and its own refusal."""
    tree, begin, end = filled(gap, cache_time_s=30)
    stamps = np.linspace(begin - S // 2, end + S // 2, rows).astype(np.int64)
    inside = (stamps > begin) & (stamps < end)
    assert inside.any()
    assert not inside.all()
    path = tree.sample("laser", "map", stamps)
    assert np.array_equal(path.gaps_ns, np.where(inside, end - begin, 0))
    assert np.array_equal(path.inverse()[inside].gaps_ns, path.gaps_ns[inside])
    assert np.array_equal((path @ path.inverse()).gaps_ns, path.gaps_ns)
    refused = tree.sample("laser", "map", stamps, max_gap_s=0.5)
    assert np.array_equal(refused.status, np.where(inside, GapTooLong.code, 0))
    assert np.array_equal(refused.poses[~inside], path.poses[~inside])
    with pytest.raises(GapTooLong):
        refused.raise_for_status()


def test_the_latest_common_time_may_lie_in_a_gap() -> None:
    """ros2/geometry2#154: a slower link ends where a faster one has its gap."""
    tree, begin, end = filled(GAPS[0])
    tree.set_transform(StampedTransform("laser", "tag", begin + 3 * S, Transform()))
    assert tree.lookup_transform("map", "tag").gap_ns == end - begin
    with pytest.raises(GapTooLong):
        tree.lookup_transform("map", "tag", max_gap_s=1)
    assert tree.lookup_latest_transform("map", "tag").gap_ns == 0


def test_a_slow_link_has_no_gap() -> None:
    """MichaelGrupp/evo#221 and others: a localisation at 0.2 Hz is slow, not interrupted."""
    tree = TransformTree(cache_time_s=100)
    for i in range(20):
        tree.set_transform(StampedTransform("map", "odom", 5 * i * S, Transform((i, 0, 0))))
    answers = tree.sample("map", "odom", np.arange(S, 90 * S, S))
    assert answers.ok.all()
    assert not answers.gaps_ns.any()


@contextmanager
def entrance(name: str, server: ServerProcess) -> Iterator[Any]:
    with server.connect(10, "shared" if name == "mapped" else "query") as tf:
        if name == "mirror":
            with tf.mirror() as mirror:
                mirror.wait_for()
                yield mirror
        elif name == "transaction":
            with tf.transaction() as transaction:
                yield transaction
        else:
            yield tf


@pytest.mark.parametrize("gap", GAPS[:2])
@pytest.mark.parametrize("name", ["query", "mapped", "mirror", "transaction"])
def test_every_entrance_says_and_refuses_gaps(
    shared_server: ServerProcess, name: str, gap: Any
) -> None:
    """ros2/geometry2#154, over the network: by query, in mapped memory, in a mirror, and in a
    transaction."""
    with shared_server.connect() as tf:
        tf.clear(keep_static=False)
        begin, end = fill(tf.set_transforms_xact, ("odom", "cart"), gap)
    middle = begin + (end - begin) // 3
    with entrance(name, shared_server) as tf:
        answer = tf.lookup_transform("odom", "cart", middle)
        assert (answer.gap_ns, answer.stamp_ns) == (end - begin, middle)
        with pytest.raises(GapTooLong) as caught:
            tf.lookup_transform("odom", "cart", middle, max_gap_s=0.5)
        assert (caught.value.frame, caught.value.gap_ns) == ("cart", end - begin)
        assert caught.value.limit == 0.5
        with pytest.raises(GapTooLong):
            tf.lookup_transform_full("odom", begin, "cart", middle, "odom", max_gap_s=0.5)
        if name == "transaction":
            return
        with pytest.raises(GapTooLong):  # there is nothing to wait for
            tf.lookup_transform("odom", "cart", middle, 100.0, max_gap_s=0.5)
        path = tf.sample("odom", "cart", [begin, middle, end])
        assert path.gaps_ns.tolist() == [0, end - begin, 0]
        refused = tf.sample("odom", "cart", [begin, middle, end], max_gap_s=0.5)
        assert refused.status.tolist() == [0, GapTooLong.code, 0]


async def test_asynchronous_clients_and_batches(shared_server: ServerProcess) -> None:
    """ros2/geometry2#154: the two forms of a client that are made from others."""
    with shared_server.connect() as tf:
        tf.clear(keep_static=False)
        begin, end = fill(tf.set_transforms_xact, ("odom", "cart"), GAPS[1])
        with tf.batch() as batch:
            plain = batch.lookup_transform("odom", "cart", begin + 5)
            refused = batch.lookup_transform("odom", "cart", begin + 5, max_gap_s=0.1)
            sampled = batch.sample("odom", "cart", [begin + 5, end], max_gap_s=0.1)
        assert plain.result().gap_ns == end - begin
        with pytest.raises(GapTooLong):
            refused.result()
        assert sampled.result().status.tolist() == [GapTooLong.code, 0]
    async with await AsyncTransformClient.connect(shared_server.endpoint) as aio:
        assert (await aio.lookup_transform("odom", "cart", begin + 5)).gap_ns == end - begin
        with pytest.raises(GapTooLong):
            await aio.lookup_transform("odom", "cart", begin + 5, max_gap_s=0.1)


@pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")
def test_mapped_memory() -> None:
    """ros2/geometry2#154: a tree of another process says the same."""
    tree, begin, end = filled(GAPS[2], _shared=True, _instance="one")
    tree._begin_lease(100)
    mapped = SharedTree(tree._region_fd())
    answer = mapped.lookup_transform("map", "laser", begin + 1)
    assert isinstance(answer, StampedTransform)
    assert answer.gap_ns == end - begin
    with pytest.raises(GapTooLong):
        mapped.lookup_transform("map", "laser", begin + 1, max_gap_s=2)
    sampled = mapped.lookup_transforms("map", "laser", np.arange(begin - 9, begin + 9), max_gap_s=2)
    assert isinstance(sampled, TransformArray)
    assert sampled.status.tolist() == [0] * 10 + [GapTooLong.code] * 8


def test_a_gate_drops_what_is_in_a_gap() -> None:
    """ros2/geometry2#154 for sensor data: the reason is the gap, and the rest passes."""
    tree, begin, end = filled(GAPS[0])
    drops: list[Any] = []
    with tree.gate("map", on_drop=drops.append, max_gap_s=1) as gate:
        for item, stamp in (("before", begin), ("inside", begin + S), ("after", end)):
            gate.put(item, "laser", stamp)
        assert {gate.get(60).item, gate.get(60).item} == {"before", "after"}
    assert [(drop.item, drop.reason) for drop in drops] == [("inside", "gap")]
    with tree.gate("map") as gate:
        gate.put("inside", "laser", begin + S)
        assert gate.get(60).transform.gap_ns == end - begin


def test_explain_names_the_gap(shared_server: ServerProcess) -> None:
    """ros2/geometry2#154: the explanation of a lookup that succeeds says what it rests on."""
    tree, begin, end = filled(GAPS[0])
    found = tree.explain("laser", "map", begin + 1)
    assert found.possible
    assert [link.gap_ns for link in found.links] == [0, end - begin]
    assert "'map' -> 'base' has no samples for 9.0 s around that time" in str(found)
    assert "in a gap of 9.0 s" in str(found)
    assert not any(link.gap_ns for link in tree.explain("laser", "map", end).links)
    with shared_server.connect() as tf:
        tf.clear(keep_static=False)
        begin, end = fill(tf.set_transforms_xact, ("odom", "cart"), GAPS[1])
        assert tf.explain("odom", "cart", begin + 1).links[0].gap_ns == end - begin


def test_commands(shared_server: ServerProcess, capsys: pytest.CaptureFixture[str]) -> None:
    """ros2/geometry2#154 on the command line."""
    with shared_server.connect() as tf:
        tf.clear(keep_static=False)
        begin, _ = fill(tf.set_transforms_xact, ("odom", "cart"), GAPS[1])
    command = ("--connect", shared_server.endpoint, "lookup", "odom", "cart")
    at = ("--at", f"{begin + S // 2}ns")
    said = call(capsys, *command, *at)
    assert "gap          800 ms without samples, interpolated" in said.stdout
    refused = call(capsys, *command, *at, "--max-gap", "500ms")
    assert refused.returncode == 1
    assert "from 'odom' to 'cart' has no sample for 0.8 s" in refused.stderr


@pytest.mark.parametrize("gap_ms", [700, 4000])
@pytest.mark.parametrize("after", [0, 2])
def test_a_gap_that_fills_the_newest_backtests(gap_ms: int, after: int) -> None:
    """A localiser that has just come back: nothing was measured in the newest window."""
    ms_ns = 1_000_000
    tree = TransformTree()
    stamps = [100 * ms_ns * i for i in range(50)]
    stamps += [stamps[-1] + (gap_ms + 100 * i) * ms_ns for i in range(after + 1)]
    for stamp_ns in stamps:
        pose = Transform((0.5e-9 * stamp_ns, 0, 0))
        tree.set_transform(StampedTransform("map", "base", stamp_ns, pose))
    found = tree.estimate_transform("map", "base", stamps[-1] + 20 * ms_ns)
    assert found.transform.translation[0] == pytest.approx(0.5e-9 * (stamps[-1] + 20 * ms_ns))
    assert found.error_m < 0.1
