"""Estimates by both clients: from the server's memory, by queries, in batches."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.support.moving_arm import MS, fill, tool_at
from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    Estimate,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    TooUncertain,
    TransformTree,
)
from zenoh_tf.errors import BY_CODE, TransformException
from zenoh_tf_client import TransformClient

pytestmark = pytest.mark.usefixtures("either_client")

END_NS = 10**18
AHEAD_NS = END_NS + 30 * MS


def off(found: Estimate, stamp_ns: int) -> float:
    difference = found.transform.translation - tool_at(stamp_ns).translation
    return float(np.linalg.norm(difference))


def embedded(end_ns: int = END_NS) -> TransformTree:
    tree = TransformTree()
    fill(tree, end_ns)
    return tree


def assert_alike(found: Estimate, expected: Estimate) -> None:
    for name in ("target_frame", "source_frame", "stamp_ns", "level", "basis", "by_ns"):
        assert getattr(found, name) == getattr(expected, name), name
    assert found.predictor == expected.predictor
    assert found.limiting_link == expected.limiting_link
    assert found.backtests == expected.backtests > 9
    np.testing.assert_allclose(found.transform.pose(), expected.transform.pose(), atol=1e-12)
    assert (found.error_m, found.error_rad) == pytest.approx(
        (expected.error_m, expected.error_rad), rel=1e-9
    )


def test_the_answer_is_the_embedded_trees(client: TransformClient) -> None:
    fill(client, END_NS)
    tree = embedded()
    for stamp_ns in (AHEAD_NS, END_NS - 15 * MS, END_NS + 90 * MS):
        for target, source in (("map", "tool"), ("tool", "map"), ("base", "arm")):
            for named in ({}, {"level": 0.99, "radius_m": 0.5}):
                found = client.estimate_transform(target, source, stamp_ns, **named)
                assert_alike(found, tree.estimate_transform(target, source, stamp_ns, **named))
    found = client.estimate_transform("map", "tool", AHEAD_NS)
    assert found.by_ns == 30 * MS and found.level >= 0.9
    assert 0 < found.error_m < 0.1 and off(found, AHEAD_NS) < 0.1
    assert set(found.predictor) == {"base", "arm"}
    static = client.estimate_transform("arm", "tool")
    assert (static.basis, static.error_m, static.error_rad) == ("static", 0, 0)


def test_now_is_the_servers_clock(client: TransformClient) -> None:
    end_ns = time.time_ns()
    fill(client, end_ns)
    found = client.estimate_transform("map", "tool", max_by_s=100.0)
    assert end_ns < found.stamp_ns <= time.time_ns()
    assert found.by_ns == found.stamp_ns - end_ns
    many = client.estimate_transforms("map", ["base", "tool"], None, max_by_s=100.0)
    assert found.stamp_ns <= many.stamps_ns[0] and all(many.stamps_ns <= time.time_ns())


def test_too_uncertain(client: TransformClient) -> None:
    fill(client, END_NS)
    found = client.estimate_transform("map", "tool", AHEAD_NS)
    ask: Callable[..., Estimate] = client.estimate_transform
    assert ask("map", "tool", AHEAD_NS, max_error_m=2 * found.error_m).level >= 0.9
    for name, limit in (("max_error_m", found.error_m / 2), ("max_error_rad", found.error_rad / 2)):
        with pytest.raises(TooUncertain) as caught:
            ask("map", "tool", AHEAD_NS, **{name: limit})
        error = caught.value
        assert (error.error_m, error.error_rad) == (found.error_m, found.error_rad)
        assert error.limit == pytest.approx(limit)
        assert (error.parent_frame, error.frame) == found.limiting_link
        assert error.by_ns == found.by_ns
    # 0.9999 needs 9,999 backtests.
    with pytest.raises(TooUncertain):
        ask("map", "tool", AHEAD_NS, level=0.9999, max_error_m=10.0)
    loose = ask("map", "tool", AHEAD_NS, level=0.9999, max_error_m=10.0, min_level=0.5)
    assert 0.5 <= loose.level < 0.9999


def test_errors_are_those_of_lookups(client: TransformClient) -> None:
    fill(client, END_NS)
    cases: list[tuple[type[TransformException], tuple[Any, ...], dict[str, str]]] = [
        (LookupException, ("map", "nobody", END_NS), {}),
        (ConnectivityException, ("map", "flag", END_NS), {}),
        (BackwardExtrapolationException, ("map", "tool", END_NS - 20_000 * MS), {}),
        (ForwardExtrapolationException, ("base", "tool", END_NS + 501 * MS), {"frame": "arm"}),
        (ForwardExtrapolationException, ("map", "base"), {"frame": "base"}),
    ]
    for kind, question, facts in cases:
        with pytest.raises(kind) as caught:
            client.estimate_transform(*question)
        assert type(caught.value) is kind
        assert caught.value.facts.items() >= facts.items()
    found = client.estimate_transform("base", "tool", END_NS + 501 * MS, max_by_s=0.6)
    assert found.by_ns == 501 * MS


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("level", level) for level in (0.0, 1.0, -1.0, math.nan, math.inf)),
        *(("max_by_s", by_s) for by_s in (-1.0, math.nan, math.inf)),
        *(("radius_m", radius) for radius in (-1.0, math.nan, math.inf)),
        *(("max_error_m", limit) for limit in (-1.0, math.nan)),
        *(("max_error_rad", limit) for limit in (-1.0, math.nan)),
        *(("min_level", level) for level in (-1.0, 1.5, math.nan)),
        ("stamp_ns", 1 << 63),
        ("stamp_ns", 0.5),
    ],
)
def test_malformed_arguments_are_named(client: TransformClient, field: str, value: Any) -> None:
    fill(client, END_NS)
    arguments = {"stamp_ns": AHEAD_NS} | {field: value}
    with pytest.raises(InvalidArgumentException) as caught:
        client.estimate_transform("map", "tool", **arguments)
    assert caught.value.field == field
    if field in ("level", "max_by_s", "radius_m"):
        with pytest.raises(InvalidArgumentException) as caught:
            client.estimate_transforms("map", "tool", AHEAD_NS, **{field: value})
        assert caught.value.field == field


@pytest.mark.parametrize(("target", "source"), [("", "tool"), ("map", "/tool"), ("map", "")])
def test_malformed_names_are_named(client: TransformClient, target: str, source: str) -> None:
    fill(client, END_NS)
    with pytest.raises(InvalidArgumentException) as caught:
        client.estimate_transform(target, source, AHEAD_NS)
    assert caught.value.field in ("target_frame", "source_frame")


def test_many_rows(client: TransformClient) -> None:
    fill(client, END_NS)
    sources = ["tool", "nobody", "flag", "base", "tool", "tool"]
    stamps_ns = [AHEAD_NS, AHEAD_NS, AHEAD_NS, END_NS, END_NS - 10**11, END_NS + 10**9]
    found = client.estimate_transforms("map", sources, stamps_ns)
    errors = [BY_CODE[code] if code else None for code in found.status.tolist()]
    assert errors == [
        *(None, LookupException, ConnectivityException, None),
        *(BackwardExtrapolationException, ForwardExtrapolationException),
    ]
    assert found.ok.tolist() == [error is None for error in errors]
    for column in (found.poses, found.error_m, found.error_rad):
        assert np.isnan(column[~found.ok]).all() and np.isfinite(column[found.ok]).all()
    one = client.estimate_transform("map", "tool", AHEAD_NS)
    assert found.error_m[0] == pytest.approx(one.error_m)
    assert found.error_rad[0] == pytest.approx(one.error_rad)
    assert found.by_ns[[0, 3]].tolist() == [30 * MS, 0]
    assert found.backtests[0] == one.backtests and found.level[0] == one.level
    np.testing.assert_allclose(found.poses[0], one.transform.pose(), atol=1e-12)
    assert len(client.estimate_transforms([], [], [])) == 0
    with pytest.raises(InvalidArgumentException):
        client.estimate_transforms("map", ["tool", "base"], [1, 2, 3])


def test_work_is_bounded(server: ServerProcess) -> None:
    """Before it is spent: by rows, by the links of all rows, and by the backtests of each pair."""
    with server.connect(reads="query") as tf:
        fill(tf, END_NS)
        assert tf.estimate_transforms("map", "tool", np.full(10_000, AHEAD_NS)).ok.all()
        for rows, field in ((60_000, "links"), (200_000, "rows")):
            with pytest.raises(LimitExceeded) as caught:
                tf.estimate_transforms("map", "tool", np.full(rows, AHEAD_NS))
            assert caught.value.field == field
        for level, most in ((0.9, 500), (0.999, 100)):
            with tf.batch() as batch:
                handles = [
                    batch.estimate_transform("map", "tool", AHEAD_NS, level=level)
                    for _ in range(most + 1)
                ]
            with pytest.raises(LimitExceeded) as caught:
                handles[-1].result()
            assert (caught.value.field, caught.value.limit) == ("links", 10_000_000)
            assert "`estimate_transforms`, where each pair counts once" in str(caught.value)
            assert handles[most // 2].result().by_ns == 30 * MS


def test_in_a_batch(client: TransformClient) -> None:
    fill(client, END_NS)
    with client.batch() as batch:
        one = batch.estimate_transform("map", "tool", AHEAD_NS, level=0.8)
        refused = batch.estimate_transform("map", "tool", AHEAD_NS, max_error_m=1e-9)
        unknown = batch.estimate_transform("map", "nobody", AHEAD_NS)
        many = batch.estimate_transforms("map", ["tool", "base"], AHEAD_NS, level=0.8)
    assert_alike(one.result(), embedded().estimate_transform("map", "tool", AHEAD_NS, level=0.8))
    with pytest.raises(TooUncertain):
        refused.result()
    with pytest.raises(LookupException):
        unknown.result()
    assert many.result().error_m[0] == pytest.approx(one.result().error_m)
