"""Estimates of a server, at its time and within its limits; and docs/how-to/estimate.md, whose
snippets run in order, on a tree and on a client. Answers are in test_answers.py."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.support.moving_arm import MS, arm_at, base_at, fill
from zenoh_tf import LimitExceeded, StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

PAGE = (Path(__file__).resolve().parents[2] / "docs/how-to/estimate.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
END_NS = 10**18
AHEAD_NS = END_NS + 30 * MS


@pytest.mark.usefixtures("either_client")
def test_now_is_the_servers_clock(client: TransformClient) -> None:
    end_ns = time.time_ns()
    fill(client, end_ns)
    found = client.estimate_transform("map", "tool", max_by_s=100.0)
    assert end_ns < found.stamp_ns <= time.time_ns()
    assert found.by_ns == found.stamp_ns - end_ns
    many = client.estimate_transforms("map", ["base", "tool"], None, max_by_s=100.0)
    assert found.stamp_ns <= many.stamps_ns[0] and all(many.stamps_ns <= time.time_ns())


@pytest.mark.usefixtures("either_client")
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


def run_page(tf: Any, tree: TransformTree) -> None:
    end_ns = time.time_ns() + 60_000 * MS  # so that now lies within, however slow the machine is
    rows = [
        StampedTransform(parent, child, stamp_ns, pose(stamp_ns))
        for parent, child, pose in (
            ("map", "base_link", base_at),
            ("base_link", "gripper", arm_at),
        )
        for stamp_ns in range(end_ns - 70_000 * MS, end_ns, 50 * MS)
    ]
    for each in {id(tf): tf, id(tree): tree}.values():
        each.set_transforms_xact(rows)
        mount = StampedTransform("base_link", "camera", 0, Transform((0.2, 0, 1)))
        each.set_transform(mount, static=True)
    scope = {"tf": tf, "tree": tree}
    for snippet in SNIPPETS:
        exec(snippet, scope)


def test_on_the_embedded_tree(capsys: pytest.CaptureFixture[str]) -> None:
    assert len(SNIPPETS) == 5
    tree = TransformTree(cache_time_s=100.0)
    run_page(tree, tree)
    assert " within " in capsys.readouterr().out


@pytest.mark.own_server
def test_on_a_client(start_server: Any, capsys: pytest.CaptureFixture[str]) -> None:
    server = start_server("--cache-time", "100s")
    with server.connect() as tf:
        run_page(tf, TransformTree(cache_time_s=100.0))
    assert " within " in capsys.readouterr().out


def test_the_fields_are_on_the_page(client: TransformClient) -> None:
    client.set_transform(StampedTransform("map", "base", 0, Transform()), static=True)
    found = client.estimate_transform("map", "base")
    table = PAGE.partition("## The fields")[2].partition("\n## ")[0]
    shown = set(re.findall(r"`(\w+)`", table))
    assert {*type(found).__match_args__} - {"target_frame", "source_frame"} <= shown
