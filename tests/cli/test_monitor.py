"""``zenoh-tf monitor``: rates, delays and ages."""

from __future__ import annotations

import json
import re

import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.show import rates

from .conftest import Run


def test_monitor_shows_links_and_authorities(robot: TransformClient, command: Run) -> None:
    ended = command("monitor", "--every", "0.2s", "--count", "2")
    assert (ended.returncode, ended.stderr) == (0, "")
    first, second = re.split(r"^in .* s: ", ended.stdout, flags=re.M)[1:]
    for period in (first, second):
        lines = [line.split() for line in period.splitlines()]
        assert lines[0] == ["3", "dynamic", "and", "1", "static", "links"]
        assert [line[2] for line in lines if "->" in line] == ["base_link", "gripper", "odom"]
        assert ["map", "->", "odom", "0.0", "1.0"] in [line[:5] for line in lines]
        assert ["amcl", "0.0", "0.0", "0", "0", "-"] in lines


def test_monitor_prints_a_document_for_each_period(robot: TransformClient, command: Run) -> None:
    ended = command("monitor", "--every", "0.2s", "--count", "2", "--json")
    periods = [json.loads(line) for line in ended.stdout.splitlines()]
    assert len(periods) == 2
    assert [link["frame"] for link in periods[0]["links"]] == ["base_link", "gripper", "odom"]
    (odom,) = [link for link in periods[0]["links"] if link["frame"] == "odom"]
    assert odom["least_age_s"] <= odom["greatest_age_s"] < 0  # this tree's stamps are ahead


def test_the_rates_of_a_link() -> None:
    """By the number of commits, whatever else they write."""
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 0, Transform()))
    before = tree.frame("base")
    for n in range(7):
        rows = [StampedTransform("map", "base", 10 * n + m, Transform()) for m in range(3)]
        tree.set_transforms_xact(rows)
    link = rates._link(tree.frame("base"), before, [0.1, 0.3, 0.2], 2.0, 100)
    assert link.commits_per_s == pytest.approx(3.5)
    assert (link.least_age_s, link.greatest_age_s) == (0.1, 0.3)


def test_the_rates_of_an_authority() -> None:
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 0, Transform()), "wheels")
    (before,) = tree.authorities()
    for n in range(4):
        rows = [StampedTransform("map", f, 10 + n, Transform()) for f in ("base", "arm")]
        tree.set_transforms_xact(rows, "wheels")
    (now,) = tree.authorities()
    rate = rates._authority(now, before, 2.0)
    assert (rate.commits_per_s, rate.transforms_per_s) == (2.0, 4.0)
    assert rates._authority(now, rates._new(now), 1.0).commits_per_s == 5.0
