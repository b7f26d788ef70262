"""Gates: every item is handed over with its transform once, or dropped with a reason."""

from __future__ import annotations

import asyncio
import random
import subprocess
import sys
import threading
import time
from collections import Counter
from typing import Any

import pytest

from tests.conftest import ServerProcess, StartServer
from tests.support.asynchronous import connected
from tests.support.waiting import wait_until
from zenoh_tf import (
    Dropped,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LookupException,
    Passed,
    StampedTransform,
    TimeoutException,
    Transform,
    TransformTree,
)
from zenoh_tf.gates.queue import MAX_FRAMES

#: Far above what any test waits for.
LONG_S = 40.0


def at(stamp_ns: int, child: str = "base", parent: str = "map") -> StampedTransform:
    """A pose whose x is its stamp."""
    return StampedTransform(parent, child, stamp_ns, Transform((stamp_ns, 0, 0)))


class Drops(list[Dropped[Any]]):
    """What a gate has dropped."""

    def reasons(self) -> Counter[str]:
        return Counter(dropped.reason for dropped in self)

    def wait(self, count: int) -> None:
        wait_until(lambda: len(self) >= count, lambda: self)


@pytest.fixture
def tree() -> TransformTree:
    tree = TransformTree()
    tree.set_transforms_xact([at(100), at(200)])
    return tree


def test_an_item_comes_with_its_transform(tree: TransformTree) -> None:
    with tree.gate("map") as gate:
        gate.put("now", "base", 150)
        assert gate.get(LONG_S) == Passed("now", at(150))
        gate.put("soon", "base", 250)
        gate.put("sooner", "base", 220)
        with pytest.raises(TimeoutException):
            gate.get(0.05)
        assert gate.stats()["held"] == 2
        tree.set_transform(at(300))
        assert {gate.get(LONG_S).item, gate.get(LONG_S).item} == {"soon", "sooner"}
        counts = gate.stats()
        assert (counts["passed"], counts["held"], counts["ready"]) == (3, 0, 0)


def test_a_newer_item_holds_no_older_one_up(tree: TransformTree) -> None:
    """The older one is put while the gate already waits for the newer one."""
    with tree.gate("map", timeout_s=LONG_S) as gate:
        gate.put("late", "base", 10_000)
        wait_until(lambda: tree.stats()["waiters"])
        gate.put("early", "base", 150)
        assert gate.get(LONG_S).item == "early"


def test_a_frame_that_comes_later(tree: TransformTree) -> None:
    with tree.gate("map", timeout_s=LONG_S) as gate:
        gate.put("image", "camera", 150)
        gate.put("cloud", "base", 150)
        assert gate.get(LONG_S).item == "cloud"  # one frame does not hold another up
        tree.set_transform(at(0, "camera", "base"), static=True)
        assert gate.get(LONG_S).transform.child_frame == "camera"


def test_each_reason(tree: TransformTree) -> None:
    drops = Drops()
    with tree.gate("map", queue_size=3, timeout_s=0.1, on_drop=drops.append) as gate:
        gate.put("old", "base", 50)
        drops.wait(1)
        gate.put("future", "base", 10**9)
        gate.put("nowhere", "camera", 150)
        drops.wait(3)
    why = {dropped.item: dropped for dropped in drops}
    assert {item: dropped.reason for item, dropped in why.items()} == {
        "old": "too_old",
        "future": "timeout",
        "nowhere": "unknown_frame",
    }
    assert (why["future"].frame, why["future"].stamp_ns) == ("base", 10**9)
    assert isinstance(why["future"].error, ForwardExtrapolationException)
    assert isinstance(why["nowhere"].error, LookupException)


def test_a_full_gate_drops_the_new_item(tree: TransformTree) -> None:
    """The oldest one is the next to succeed."""
    drops = Drops()
    with tree.gate("map", queue_size=3, timeout_s=LONG_S, on_drop=drops.append) as gate:
        for stamp in range(201, 206):
            gate.put(stamp, "base", stamp)
        assert [(dropped.item, dropped.reason) for dropped in drops] == [
            (204, "full"),
            (205, "full"),
        ]
        tree.set_transform(at(300))
        assert {gate.get(LONG_S).item for _ in range(3)} == {201, 202, 203}
        for number in range(3):
            gate.put(number, "base", 250)
        wait_until(lambda: gate.stats()["ready"] >= 3)
        gate.put(3, "base", 250)  # those that nobody has fetched count, too
        assert drops.reasons() == {"full": 3}
    assert drops.reasons() == {"full": 3, "closed": 3}


def test_too_many_frames(tree: TransformTree) -> None:
    drops = Drops()
    with tree.gate("map", queue_size=1_000, timeout_s=LONG_S, on_drop=drops.append) as gate:
        for number in range(MAX_FRAMES + 2):
            gate.put(number, f"frame{number}", 150)
        assert [dropped.item for dropped in drops] == [MAX_FRAMES, MAX_FRAMES + 1]
        gate.put("another", "frame0", 150)
        assert gate.stats()["held"] == MAX_FRAMES + 1


def test_closing(tree: TransformTree) -> None:
    drops = Drops()
    gate = tree.gate("map", timeout_s=LONG_S, on_drop=drops.append)
    got: list[Any] = []
    reader = threading.Thread(target=lambda: got.extend(gate))
    reader.start()
    gate.put("waits", "base", 10**9)
    gate.close()
    gate.close()
    reader.join(LONG_S)
    assert not reader.is_alive()
    gate.put("after", "base", 150)
    assert [(dropped.item, dropped.reason) for dropped in drops] == [
        ("waits", "closed"),
        ("after", "closed"),
    ]
    with pytest.raises(TimeoutException, match="closed"):
        gate.get()
    assert not got


def test_an_error_in_on_drop_harms_nothing(tree: TransformTree) -> None:
    def fail(dropped: Dropped[Any]) -> None:
        raise RuntimeError(dropped.reason)

    with tree.gate("map", queue_size=1, timeout_s=LONG_S, on_drop=fail) as gate:
        gate.put("first", "base", 250)
        gate.put("second", "base", 250)
        tree.set_transform(at(300))
        assert gate.get(LONG_S).item == "first"


BAD: dict[str, list[Any]] = {
    "target": ["", "/map", None],
    "queue_size": [0, 100_001, 1.5],
    "timeout_s": [0, 3_601, float("nan")],
}


@pytest.mark.parametrize(("name", "value"), [(name, bad) for name in BAD for bad in BAD[name]])
def test_bad_arguments(tree: TransformTree, name: str, value: Any) -> None:
    arguments: dict[str, Any] = {"target": "map", name: value}
    with pytest.raises(InvalidArgumentException):
        tree.gate(**arguments)


@pytest.mark.parametrize(
    ("frame", "stamp"), [("", 1), ("/a", 1), (7, 1), ("a", None), ("a", 1.5), ("a", 1 << 63)]
)
def test_bad_items(tree: TransformTree, frame: Any, stamp: Any) -> None:
    with tree.gate("map") as gate, pytest.raises(InvalidArgumentException):
        gate.put("item", frame, stamp)


def test_a_program_may_end_with_an_open_gate() -> None:
    text = """
from zenoh_tf import StampedTransform, Transform, TransformTree
tree = TransformTree()
gate = tree.gate("map", timeout_s=3600)
gate.put("image", "camera", 1)
print("end")
"""
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, timeout=LONG_S, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "end\n", "")


# --- many items: late, early and missing transforms

FRAMES = ("lidar", "camera", "radar", "sonar")
STEP = 1_000_000
FIRST, LAST = 100, 600  # the steps that get transforms


def plan(count: int, seed: int) -> list[tuple[int, str, int]]:
    """(number, frame, stamp) of items: some before the history, some after it, some in frames that
    never come."""
    rng = random.Random(seed)
    items = []
    for number in range(count):
        frame = rng.choice(FRAMES) if rng.random() < 0.95 else "nowhere"
        step = rng.uniform(FIRST, LAST)
        if rng.random() < 0.05:
            step = rng.choice((rng.uniform(0, FIRST - 1), rng.uniform(LAST + 1, LAST + 100)))
        items.append((number, frame, int(step * STEP)))
    return items


def expected(frame: str, stamp: int) -> str:
    """What becomes of an item in a gate whose time-out is longer than the test."""
    if frame == "nowhere" or stamp > LAST * STEP:
        return "closed"
    return "too_old" if stamp < FIRST * STEP else "passed"


def ends(items: list[tuple[int, str, int]]) -> int:
    """How many of the items leave an open gate."""
    return sum(expected(frame, stamp) != "closed" for _, frame, stamp in items)


def check_each_once(
    items: list[tuple[int, str, int]], passed: list[Passed[int]], drops: Drops
) -> None:
    outcomes = {each.item: "passed" for each in passed}
    outcomes |= {dropped.item: dropped.reason for dropped in drops}
    assert len(passed) + len(drops) == len(items) == len(outcomes)  # each exactly once
    wrong = [
        (number, frame, stamp, outcomes[number])
        for number, frame, stamp in items
        if outcomes[number] != expected(frame, stamp)
    ]
    assert not wrong, wrong[:5]
    for each in passed:
        _, frame, stamp = items[each.item]
        assert (each.transform.child_frame, each.transform.stamp_ns) == (frame, stamp)
        assert abs(each.transform.transform.translation[0] - stamp) < 1e-3


def publish(tree: Any, step: int) -> None:
    tree.set_transforms_xact([at(step * STEP, frame) for frame in FRAMES])


def run_many(tree: Any, reader: Any, count: int) -> None:
    """Items come before and after their transforms, from one thread; transforms from another."""
    items = plan(count, 5)
    drops = Drops()
    passed: list[Passed[int]] = []
    publish(tree, FIRST)
    with reader.gate("map", queue_size=count, timeout_s=600, on_drop=drops.append) as gate:

        def put() -> None:
            for number, frame, stamp in items:
                gate.put(number, frame, stamp)

        putter = threading.Thread(target=put)
        putter.start()
        for step in range(FIRST + 1, LAST + 1):
            publish(tree, step)
        putter.join()
        deadline_s, leaving = time.monotonic() + LONG_S, ends(items)
        while len(passed) + len(drops) < leaving:
            assert time.monotonic() < deadline_s, gate.stats()
            try:
                passed.append(gate.get(0.2))
            except TimeoutException:
                continue
        assert gate.stats()["held"] == count - leaving
    # The gate's threads may still be reporting a drop.
    wait_until(lambda: len(passed) + len(drops) >= count, "all items")
    check_each_once(items, passed, drops)


def test_10000_items_of_an_embedded_tree() -> None:
    tree = TransformTree()
    run_many(tree, tree, 10_000)


def test_10000_items_of_a_client(server: ServerProcess) -> None:
    with server.connect() as writer, server.connect() as reader:
        run_many(writer, reader, 10_000)


def test_a_mirror_and_shared_memory(server: ServerProcess) -> None:
    with server.connect(reads="shared") as client:
        client.set_transforms_xact([at(100), at(200)])
        with client.mirror() as mirror:
            mirror.wait_for()
            for reader in (client, mirror):
                with reader.gate("map", timeout_s=LONG_S) as gate:
                    gate.put("now", "base", 150)
                    assert gate.get(LONG_S).item == "now"
                    stamp = client.lookup_transform("map", "base").stamp_ns + 100
                    gate.put("soon", "base", stamp)
                    client.set_transform(at(stamp))
                    assert gate.get(LONG_S) == Passed("soon", at(stamp))


def test_a_server_that_comes_back(start_server: StartServer) -> None:
    server = start_server()
    with server.connect(timeout_s=2.0) as client, client.gate("map", timeout_s=LONG_S) as gate:
        gate.put("image", "base", 150)
        server.kill()
        again = start_server(endpoint=server.endpoint)
        with again.connect() as writer:
            writer.set_transforms_xact([at(100), at(200)])
        assert gate.get(LONG_S).item == "image"


# --- asyncio


async def test_async(server: ServerProcess) -> None:
    drops = Drops()
    async with await connected(server) as tf:
        await tf.set_transforms_xact([at(100), at(200)])
        with tf.gate("map", queue_size=3, timeout_s=LONG_S, on_drop=drops.append) as gate:
            gate.put("old", "base", 50)
            gate.put("now", "base", 150)
            passing = aiter(gate)
            assert await anext(passing) == Passed("now", at(150))
            gate.put("soon", "base", 250)
            gate.put("never", "camera", 250)
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(anext(passing), 0.05)  # takes nothing with it
            await tf.set_transform(at(300))
            async for item, transform in gate:
                assert (item, transform) == ("soon", at(250))
                break
            rest = asyncio.create_task(anext(aiter(gate), None))
            await asyncio.sleep(0)
        assert await rest is None
        drops.wait(2)
        assert {(d.item, d.reason) for d in drops} == {("old", "too_old"), ("never", "closed")}
        assert gate.stats()["passed"] == 2


async def test_10000_items_async(server: ServerProcess) -> None:
    """Two tasks share the items of one gate."""
    items = plan(10_000, 6)
    drops = Drops()
    passed: list[Passed[int]] = []
    async with await connected(server) as tf:
        await asyncio.gather(*(tf.set_transform(at(FIRST * STEP, frame)) for frame in FRAMES))
        options: dict[str, Any] = {"timeout_s": 600.0, "on_drop": drops.append}
        with tf.gate("map", queue_size=len(items), **options) as gate:

            async def gather() -> None:
                async for each in gate:
                    passed.append(each)

            tasks = [asyncio.create_task(gather()) for _ in range(2)]
            for number, frame, stamp in items:
                gate.put(number, frame, stamp)
                if number % 100 == 0:
                    await asyncio.sleep(0.001)
            for step in range(FIRST + 1, LAST + 1):
                await tf.set_transforms_xact([at(step * STEP, frame) for frame in FRAMES])
            leaving = ends(items)
            while len(passed) + len(drops) < leaving:
                await asyncio.sleep(0.01)
        await asyncio.gather(*tasks)
    drops.wait(len(items) - len(passed))
    check_each_once(items, passed, drops)
