"""Every snippet of docs/how-to/estimate.md runs, in order, on a tree and on a client."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import pytest

from tests.support.moving_arm import MS, arm_at, base_at
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

PAGE = (Path(__file__).resolve().parents[2] / "docs/how-to/estimate.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


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
