"""Lookups in a server's memory and by queries give the same answers and errors."""

from __future__ import annotations

import random
import re
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.runs import CONTROLS
from zenoh_tf import (
    EstimateArray,
    InvalidArgumentException,
    StampedTransform,
    Transform,
    TransformArray,
    TransformException,
)
from zenoh_tf_client import TransformClient

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")

NOW_NS = 10**18


@pytest.fixture(scope="module")
def both(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[TransformClient, TransformClient]]:
    """Two clients of one server: one reads its memory, one by queries."""
    log = tmp_path_factory.mktemp("log") / "server.log"
    with tempfile.TemporaryDirectory() as path:
        server = ServerProcess(log, free_endpoint(), "main", ("--share-dir", path))
        with server.connect(reads="shared") as shared, server.connect(reads="query") as query:
            assert (shared.reads, query.reads) == ("shared", "query")
            yield shared, query
        server.stop()


def tree_of(rng: random.Random) -> list[StampedTransform]:
    """Two trees of frames, sampled irregularly."""
    frames = {"a": ["a0"], "b": ["b0"]}
    rows = []
    for _ in range(20):
        tree = rng.choice("aab")
        parent = rng.choice(frames[tree])
        child = f"{tree}{len(frames[tree])}"
        frames[tree].append(child)
        for _ in range(rng.choice((1, 5, 30))):
            pose = Transform(
                (rng.random(), rng.random(), 1), rng.choice([(0, 0, 0.6, 0.8), (0, 1, 0, 0)])
            )
            rows.append(StampedTransform(parent, child, NOW_NS + rng.randrange(10**9), pose))
    return rows


def question(rng: random.Random) -> tuple[str, tuple[Any, ...]]:
    def frame() -> Any:
        usual = [f"{tree}{number}" for tree in "aaab" for number in range(8)]
        return rng.choice([*usual, "nobody"])

    def stamp() -> Any:
        between = NOW_NS + rng.randrange(10**9)
        return rng.choice([None, between, between, between, 0, 2**62])

    def frames() -> list[Any]:
        return [frame() for _ in range(3)]

    a, b, c = frames()
    return rng.choice(
        [
            ("lookup_transform", (a, b, stamp())),
            ("lookup_transform_full", (a, stamp(), b, stamp(), c)),
            ("can_transform", (a, b, stamp())),
            ("lookup_latest_transform", (a, b)),
            ("lookup_latest_transform_xact", (a, b)),
            ("lookup_latest_transforms_xact", ([(a, b), (b, c)],)),
            ("latest_common_time", (a, b)),
            ("lookup_transforms", (a, frames(), stamp())),
            ("lookup_transforms", (frames(), b, [stamp() or 1 for _ in range(3)])),
            ("sample", (a, b, [NOW_NS, NOW_NS + 1])),
            ("lookup_velocity", (a, b, stamp(), rng.choice([0.01, 0.1]))),
            ("estimate_transform", (a, b, NOW_NS + rng.randrange(2 * 10**9))),
            ("estimate_transforms", (a, frames(), NOW_NS + rng.randrange(2 * 10**9))),
            ("parent", (a, stamp())),
            ("chain", (a, b, stamp())),
            ("frame", (a,)),
            ("explain", (a, b, stamp())),
        ]
    )


def outcome(tf: TransformClient, name: str, arguments: tuple[Any, ...]) -> Any:
    try:
        found = getattr(tf, name)(*arguments)
    except (TransformException, TypeError, ValueError) as error:
        return type(error).__name__, str(error), vars(error)
    if isinstance(found, EstimateArray):
        errors = found.error_m, found.error_rad, found.level, found.backtests, found.by_ns
        return found.status.tolist(), rounded([each.tolist() for each in (found.poses, *errors)])
    if isinstance(found, TransformArray):
        return found.status.tolist(), found.stamps_ns.tolist(), rounded(found.translations)
    return rounded(found)


def rounded(found: Any) -> str:
    """As text, without what depends on the order of additions."""
    number = re.compile(r"-?\d+\.\d*(e-?\d+)?")
    return number.sub(lambda text: f"{round(float(text[0]), 7) + 0.0:g}", repr(found))


@pytest.mark.parametrize("concurrency", CONTROLS)
def test_both_ways_give_the_same_answers_and_errors(
    start_sharing: StartServer, concurrency: str
) -> None:
    rng = random.Random(17)
    server = start_sharing("--concurrency", concurrency)
    with server.connect(reads="shared") as shared, server.connect(reads="query") as query:
        shared.set_transforms_xact(tree_of(rng))
        answered = 0
        for _ in range(1500):
            name, arguments = question(rng)
            by_query = outcome(query, name, arguments)
            assert outcome(shared, name, arguments) == by_query, (name, arguments)
            answered += not isinstance(by_query, tuple)
        assert sorted(shared.frames()) == sorted(query.frames())
        assert answered > 200
        asked = {name: n for name, n in shared.stats().items() if name.startswith("reads_asked")}
        assert not any(asked.values()), asked


@pytest.mark.parametrize(
    ("name", "arguments", "field"),
    [
        ("lookup_transform", ("a", "b", 2**63), "stamp_ns"),
        ("lookup_transform", ("a", "b", 1.5), "stamp_ns"),
        ("lookup_transform", ("", "b"), "target_frame"),
        ("lookup_transform", ("a", "/b"), "source_frame"),
        ("lookup_transform_full", ("a", 1, "b", -(2**63), "c"), "source_stamp_ns"),
        ("lookup_velocity", ("a", "b", None, -1.0), "averaging_interval_s"),
        ("estimate_transform", ("a", "/b", 1), "source_frame"),
        ("estimate_transform", ("a", "b", 2**63), "stamp_ns"),
        ("estimate_transforms", ("a", "b", [1.5]), "stamps_ns"),
        ("chain", ("a", ""), "source_frame"),
        ("frame", ("",), "frame"),
        ("explain", ("a", "/b"), "source_frame"),
    ],
)
def test_both_ways_refuse_malformed_arguments(
    both: tuple[TransformClient, TransformClient], name: str, arguments: Any, field: str
) -> None:
    for tf in both:
        with pytest.raises(InvalidArgumentException) as caught:
            getattr(tf, name)(*arguments)
        assert caught.value.field == field


@pytest.mark.parametrize("timeout_s", [-1.0, float("nan"), 1e9])
def test_both_ways_refuse_a_malformed_timeout(
    both: tuple[TransformClient, TransformClient], timeout_s: float
) -> None:
    for tf in both:
        with pytest.raises(InvalidArgumentException) as caught:
            tf.lookup_transform("a", "b", timeout_s=timeout_s)
        assert caught.value.field == "timeout_s"
