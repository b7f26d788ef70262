"""Every snippet of docs/how-to/sensor-data.md runs, in order, on a tree and on a client."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zenoh_tf import Dropped, StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

PAGE = (Path(__file__).resolve().parents[2] / "docs/how-to/sensor-data.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
BEGIN_NS, MS = 10**18, 1_000_000


def fill(tf: Any) -> None:
    rows = []
    for i in range(40):
        turn = Transform.from_rpy(0, 0, 0.01 * i, (0.01 * i, 0, 0))
        rows.append(StampedTransform("odom", "base", BEGIN_NS + 10 * MS * i, turn))
        rows.append(StampedTransform("map", "odom", BEGIN_NS + 10 * MS * i, Transform((1, 2, 0))))
    tf.set_transforms_xact(rows)
    for sensor in ("lidar", "camera"):
        mount = StampedTransform("base", sensor, 0, Transform((0.2, 0, 1)))
        tf.set_transform(mount, static=True)


def names(tf: Any) -> dict[str, Any]:
    """What the page assumes."""
    rng = np.random.default_rng(1)
    reasons: list[str] = []

    def report(dropped: Dropped[Any]) -> None:
        reasons.append(dropped.reason)

    return {
        "np": np,
        "tf": tf,
        "points": rng.normal(size=(20_000, 3)),
        "out": np.empty((20_000, 3)),
        "stamps_ns": np.linspace(BEGIN_NS, BEGIN_NS + 100 * MS, 20_000).astype(np.int64),
        "grid": rng.normal(size=(16, 64, 3)).astype(np.float32),
        "column_stamps_ns": np.linspace(BEGIN_NS, BEGIN_NS + 100 * MS, 64).astype(np.int64),
        "image": object(),
        "stamp_ns": BEGIN_NS + 55 * MS,
        "report": report,
        "reasons": reasons,
    }


def run_page(tf: Any, client: TransformClient, capsys: pytest.CaptureFixture[str]) -> None:
    fill(tf)
    if client is not tf:
        fill(client)
    scope = names(tf) | {"client": client}
    for snippet in SNIPPETS:
        exec(snippet, scope)
    assert capsys.readouterr().out == f"map camera True\n1 []\nfound {BEGIN_NS + 390 * MS} True\n"
    expected = tf.deskew(scope["points"], scope["stamps_ns"], "lidar", "map", BEGIN_NS + 100 * MS)
    now = tf.lookup_transform("map", "lidar", BEGIN_NS + 100 * MS).transform
    np.testing.assert_allclose(scope["in_map"], now.apply(expected), rtol=0, atol=1e-9)
    np.testing.assert_allclose(scope["out"], now.apply(expected), rtol=0, atol=1e-9)


def test_on_the_embedded_tree(client: TransformClient, capsys: pytest.CaptureFixture[str]) -> None:
    assert len(SNIPPETS) >= 8
    run_page(TransformTree(), client, capsys)


def test_on_a_client(client: TransformClient, capsys: pytest.CaptureFixture[str]) -> None:
    run_page(client, client, capsys)
