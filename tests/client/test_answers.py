"""Every read has the embedded tree's answer, or its error: by queries of each client, in batches,
from a server's memory, in a mirror, and at a replica."""

from __future__ import annotations

import math
import random
import re
import time
from typing import Any

import numpy as np
import pytest

from tests.conftest import LendServer, linux
from tests.processes.replicas import wait_for_writes
from tests.processes.servers import ServerProcess
from tests.support import moving_arm
from tests.support.runs import CONTROLS
from zenoh_tf import (
    EstimateArray,
    FrameInfo,
    InvalidArgumentException,
    StampedTransform,
    Transform,
    TransformArray,
    TransformException,
    TransformTree,
    Velocity,
)
from zenoh_tf_client import TransformClient

NOW_NS = 10**18
END_NS = NOW_NS + 10**9
FLOAT = re.compile(r"-?\d+(?:\.\d+)?e[-+]?\d+|-?\d+\.\d+")


def rows_of(rng: random.Random) -> dict[bool, list[StampedTransform]]:
    """Two trees of frames, sampled irregularly; by whether the links are static."""
    frames = {"a": ["a0"], "b": ["b0"]}
    rows: dict[bool, list[StampedTransform]] = {False: [], True: []}
    for _ in range(24):
        tree = rng.choice("aab")
        parent = rng.choice(frames[tree])
        child = f"{tree}{len(frames[tree])}"
        frames[tree].append(child)
        is_static = rng.random() < 0.2
        for _ in range(1 if is_static else rng.choice((1, 5, 30))):
            pose = Transform(
                (rng.random(), rng.random(), 1), rng.choice([(0, 0, 0.6, 0.8), (0, 1, 0, 0)])
            )
            stamp_ns = NOW_NS + rng.randrange(10**9)
            rows[is_static].append(StampedTransform(parent, child, stamp_ns, pose))
    return rows


def fill(tf: Any) -> TransformTree:
    """Write the same to `tf` and to an embedded tree, which is returned."""
    tree = TransformTree()
    for is_static, rows in rows_of(random.Random(17)).items():
        for each in (tree, tf):
            each.set_transforms_xact(rows, f"static: {is_static}", static=is_static)
    for each in (tree, tf):
        moving_arm.fill(each, END_NS)
    return tree


def question(rng: random.Random) -> tuple[Any, ...]:
    """The name of a method, its arguments, and at the end those that are named."""

    def frame() -> Any:
        usual = [f"{tree}{number}" for tree in "aaab" for number in range(8)]
        return rng.choice([*usual, "nobody", "a99"])

    def stamp() -> Any:
        between = NOW_NS + rng.randrange(10**9)
        return rng.choice([None, between, between, between, 0, 2**62])

    a, b, c = frames = [frame() for _ in range(3)]
    if rng.random() < 0.2:
        a, b, c = frames = rng.choices(["map", "base", "arm", "tool", "flag", "nobody"], k=3)
    ahead_ns = END_NS + rng.randrange(-(10**9), 7 * 10**8)
    point = {"reference_point": np.arange(3), "reference_point_frame": c}
    seen_from = rng.choice([{}, {"reference_frame": c}, point])
    bounds = rng.choice(
        [
            {},
            {"level": 0.99, "radius_m": 0.5},
            {"max_error_m": 1e-3},
            {"max_error_rad": 1e-3, "max_by_s": 0.6},
            {"level": 0.9999, "max_error_m": 10.0},
            {"level": 0.9999, "max_error_m": 10.0, "min_level": 0.5},
        ]
    )
    questions: list[tuple[Any, ...]] = [
        ("lookup_transform", a, b, stamp(), {}),
        ("lookup_transform_full", a, stamp(), b, stamp(), c, {}),
        ("can_transform", a, b, stamp(), {}),
        ("lookup_latest_transform", a, b, {}),
        ("lookup_latest_transform_xact", a, b, {}),
        ("lookup_latest_transforms_xact", [(a, b), (b, c)][: rng.randrange(3)], {}),
        ("latest_common_time", a, b, {}),
        ("lookup_transforms", a, frames, stamp(), {}),
        ("lookup_transforms", [], [], None, {}),
        ("lookup_transforms", frames, b, [stamp() or 1 for _ in range(3)], {}),
        ("sample", a, b, [NOW_NS, *range(NOW_NS + 1, NOW_NS + 10**9, 10**8)], {}),
        ("sample", a, b, np.array([1, 2, 100], rng.choice(["u1", "u4", "i2", "<u8", ">u8"])), {}),
        ("lookup_velocity", a, b, stamp(), rng.choice([0.01, 0.1]), seen_from),
        ("lookup_velocity", a, b, np.int64(ahead_ns), 0.25, {}),
        ("estimate_transform", a, b, ahead_ns, bounds),
        ("estimate_transforms", a, frames, ahead_ns, {"level": 0.8}),
        ("estimate_transforms", [], [], [], {}),
        ("parent", a, stamp(), {}),
        ("chain", a, b, stamp(), {}),
        ("frame", a, {}),
        ("frames", {}),
        ("explain", a, b, stamp(), {}),
    ]
    return rng.choice(questions)


def outcome(tf: Any, name: str, *arguments: Any) -> tuple[str, list[float]]:
    """The answer, or the error with its facts: as text, and the numbers that stand in it."""
    *plain, named = arguments
    try:
        found = getattr(tf, name)(*plain, **named)
    except TransformException as error:
        found = [type(error).__name__, str(error), error.facts]
    if isinstance(found, EstimateArray):
        columns = found.poses, found.error_m, found.error_rad, found.level, found.backtests
        found = [each.tolist() for each in (found.status, *columns, found.by_ns)]
    elif isinstance(found, TransformArray):
        found = [each.tolist() for each in (found.status, found.stamps_ns[found.ok], found.poses)]
    elif isinstance(found, Velocity):
        found = [getattr(found, slot) for slot in Velocity.__slots__]
        found[:2] = [each.tolist() for each in found[:2]]
    elif isinstance(found, FrameInfo):  # without what depends on the commits of other tests
        found = [found.parent, found.authority, found.static, found.samples, found.newest_stamp_ns]
    elif name == "frames":
        found = sorted(found)
    text = repr(found)
    return FLOAT.sub("number", text), [float(number) for number in FLOAT.findall(text)]


class InBatches:
    """Asks each question in a batch of its own."""

    def __init__(self, tf: TransformClient) -> None:
        self._tf = tf

    def __getattr__(self, name: str) -> Any:
        def ask(*arguments: Any, **named: Any) -> Any:
            with self._tf.batch() as batch:
                handle = getattr(batch, name)(*arguments, **named)
            return handle.result()

        return ask


def check_answers(tf: Any, tree: TransformTree, count: int = 1000) -> None:
    rng = random.Random(18)
    answered = 0
    for _ in range(count):
        asked = question(rng)
        if isinstance(tf, InBatches) and asked[0] == "explain":
            continue  # batches do not have it
        (text, numbers), (expected, exact) = outcome(tf, *asked), outcome(tree, *asked)
        assert text == expected, asked
        # The order of products may differ.
        np.testing.assert_allclose(numbers, exact, rtol=1e-9, atol=1e-12, err_msg=str(asked))
        answered += "Exception" not in text
    assert answered > count // 5


INVALID: list[tuple[str, tuple[Any, ...], dict[str, Any], str]] = [
    ("lookup_transform", ("a0", "a1", 1.5), {}, "stamp_ns"),
    ("lookup_transform", ("a0", "a1", "now"), {}, "stamp_ns"),
    ("lookup_transform", ("", "a1"), {}, "target_frame"),
    ("lookup_transform", ("a0", "/a1"), {}, "source_frame"),
    ("estimate_transform", ("", "a1"), {}, "target_frame"),
    ("estimate_transform", ("a0", "/a1", 1), {}, "source_frame"),
    ("estimate_transform", ("a0", "", 1), {}, "source_frame"),
    ("estimate_transform", ("a0", "a1", 0.5), {}, "stamp_ns"),
    ("estimate_transforms", ("a0", "a1", [1.5]), {}, "stamps_ns"),
    ("sample", ("a0", "a1", [0.5]), {}, "stamps_ns"),
    ("chain", ("a0", ""), {}, "source_frame"),
    ("frame", ("",), {}, "frame"),
    ("explain", ("a0", "/a1"), {}, "source_frame"),
    ("lookup_velocity", ("a0", "a1"), {"reference_frame": "/map"}, "reference_frame"),
    ("lookup_velocity", ("a0", "a1"), {"reference_point": (1, 2)}, "reference_point"),
    ("lookup_velocity", ("a0", "a1"), {"reference_point": (1, 2, math.inf)}, "reference_point"),
    ("lookup_velocity", ("a0", "a1", 0.5), {}, "stamp_ns"),
    *(
        ("lookup_velocity", ("a0", "a1", None, interval_s), {}, "averaging_interval_s")
        for interval_s in (0.0, -0.1, 1e-10, math.nan, math.inf)
    ),
    *(
        ("lookup_transform", ("a0", "a1"), {"timeout_s": timeout_s}, "timeout_s")
        for timeout_s in (-1.0, math.nan)
    ),
    *(
        ("estimate_transform", ("map", "tool", END_NS), {field: value}, field)
        for field, values in {
            "level": (0.0, 1.0, -1.0, math.nan, math.inf),
            "max_by_s": (-1.0, math.nan, math.inf),
            "radius_m": (-1.0, math.nan, math.inf),
            "max_error_m": (-1.0, math.nan),
            "max_error_rad": (-1.0, math.nan),
            "min_level": (0.0, -1.0, 1.5, math.nan),
        }.items()
        for value in values
    ),
    *(
        ("estimate_transforms", ("map", "tool", END_NS), {field: value}, field)
        for field in ("level", "max_by_s", "radius_m")
        for value in (-1.0, math.nan, math.inf)
    ),
]
#: -2^63 stands for "no time given" in a message, so no caller may pass it.
for _stamp_ns in (1 << 63, -(1 << 63), 1 << 64, 1 << 70, -(1 << 70)):
    INVALID += [
        ("sample", ("a0", "a1", [_stamp_ns]), {}, "stamps_ns"),
        ("lookup_transforms", (["a0"], "a1", [_stamp_ns]), {}, "stamps_ns"),
        ("lookup_transforms", ("a0", "a1", _stamp_ns), {}, "stamps_ns"),
        ("lookup_transform", ("a0", "a1", _stamp_ns), {}, "stamp_ns"),
        ("lookup_velocity", ("a0", "a1", _stamp_ns), {}, "stamp_ns"),
        ("estimate_transform", ("a0", "a1", _stamp_ns), {}, "stamp_ns"),
        ("estimate_transforms", ("a0", "a1", _stamp_ns), {}, "stamps_ns"),
        ("parent", ("a1", _stamp_ns), {}, "stamp_ns"),
        ("chain", ("a0", "a1", _stamp_ns), {}, "stamp_ns"),
        ("lookup_transform_full", ("a0", _stamp_ns, "a1", 2, "a2"), {}, "target_stamp_ns"),
        ("lookup_transform_full", ("a0", 2, "a1", _stamp_ns, "a2"), {}, "source_stamp_ns"),
    ]

_stamps: Any
for _stamps in (
    np.array([12, -(1 << 63)], np.int64),
    np.array([12, 1 << 63], np.uint64),
    np.array([(1 << 64) - 1], np.uint64),
    [-(1 << 63) - 1],
    np.uint64(1 << 63),
    [True, False],
    [[12], [13]],
):
    INVALID += [
        ("sample", ("a0", "a1", _stamps), {}, "stamps_ns"),
        ("lookup_transforms", (["a0"] * np.size(_stamps), "a1", _stamps), {}, "stamps_ns"),
    ]


def check_invalid(tf: Any) -> None:
    """Arguments that no tree accepts are named."""
    for name, arguments, named, field in INVALID:
        with pytest.raises(InvalidArgumentException) as caught:
            getattr(tf, name)(*arguments, **named)
        assert caught.value.field == field, (name, arguments, named)
    for look_up in (tf.lookup_transforms, tf.estimate_transforms):
        for columns in (("a0", ["a1", "a2"], [1, 2, 3]), (["a0"], ["a1", "a2"], None)):
            with pytest.raises(InvalidArgumentException):
                look_up(*columns)


def row(parent: str, child: str) -> StampedTransform:
    return StampedTransform(parent, child, NOW_NS, Transform())


def check_refused(tf: Any, tree: TransformTree) -> None:
    """Writes that a tree refuses change nothing."""
    refused: list[tuple[Any, ...]] = [
        ("set_transform", row("a0", "x" * 256), {}),
        ("set_transform", row("a0", "a0"), {}),
        ("set_transform", row("arm", "map"), {}),
        ("set_transforms_xact", [row("a0", "new"), row("new2", "new2")], {}),
    ]
    for asked in refused:
        assert outcome(tf, *asked) == outcome(tree, *asked)
        assert outcome(tf, "frames", {}) == outcome(tree, "frames", {})


def test_an_embedded_tree_names_invalid_arguments() -> None:
    check_invalid(fill(TransformTree()))


@pytest.mark.usefixtures("either_client")
def test_queries(any_server: ServerProcess) -> None:
    with any_server.connect() as tf:
        tree = fill(tf)
        check_answers(tf, tree)
        check_answers(InBatches(tf), tree, 300)
        check_invalid(tf)
        check_refused(tf, tree)
        with pytest.raises(InvalidArgumentException, match="from 0 to 3600 s") as caught:
            tf.lookup_transform("a0", "a1", timeout_s=1e9)
        assert caught.value.field == "timeout_s"


@linux
@pytest.mark.parametrize("concurrency", CONTROLS)
def test_shared_memory(lend_server: LendServer, concurrency: str) -> None:
    with lend_server("--concurrency", concurrency).connect(reads="shared") as tf:
        assert tf.reads == "shared"
        before = tf.stats()
        check_answers(tf, fill(tf))
        check_invalid(tf)
        now = tf.stats()
        asked = {name: n - before[name] for name, n in now.items() if name.startswith("reads_ask")}
        assert not any(asked.values()), asked


@pytest.mark.usefixtures("either_client")
def test_a_mirror(client: TransformClient) -> None:
    tree = fill(client)
    with client.mirror() as m:
        m.wait_for()
        check_answers(m, tree)
        check_invalid(m)
        assert m.synced and m.instance == client.instance and m.instance in repr(m)


def test_a_replica(primary: ServerProcess, near: TransformClient) -> None:
    with primary.connect(10) as tf:
        tree = fill(tf)
        wait_for_writes(tf, near)
    check_answers(near, tree)
    check_invalid(near)
    begin_ns = time.time_ns()
    assert begin_ns <= near.estimate_transform("arm", "tool").stamp_ns <= time.time_ns()
    assert {"replica_age_s", "replica_seq", "replica_snapshots"} <= near.stats().keys()
    assert near.age_s is not None
