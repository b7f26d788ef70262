"""``zenoh-tf monitor`` and ``top``: rates, delays and ages of links and publishers."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.support.command_line import Run
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.show import rates
from zenoh_tf_tools.cli.show.pair_delays import PairDelay, PairWatch
from zenoh_tf_tools.cli.show.rates import AuthorityRate, LinkRate, Period
from zenoh_tf_tools.cli.show.top import board

LINK = LinkRate("odom", "map", "amcl", 10.0, 10.1, 0.1, 0.2, False)
AUTHORITY = AuthorityRate("amcl", 10.0, 10.0, 0, 0, -0.1)


def drawn(period: Period, order: str = "age", rows: int = 100) -> str:
    """The board as text."""
    return board("main", period, order, rows)


def test_the_board_has_links_and_publishers() -> None:
    text = drawn(Period(1.0, 4, [LINK], [AUTHORITY]))
    assert "tree 'main': 1 dynamic and 4 static links, 1 publishers" in text
    assert "map -> odom" in text and "10.1" in text and "0.200" in text
    assert "stopped" not in text


def test_stopped_links_come_first_and_in_red(monkeypatch: pytest.MonkeyPatch) -> None:
    old = replace(LINK, frame="arm", stopped=True, greatest_age_s=1.0)
    late = replace(LINK, frame="base", greatest_age_s=5.0)
    text = drawn(Period(1.0, 0, [LINK, late, old], []))
    assert text.index("-> arm") < text.index("-> base") < text.index("-> odom")
    assert "1 stopped" in text
    monkeypatch.setattr(output, "_coloured", lambda: True)
    assert "\x1b[1;31mmap -> arm" in drawn(Period(1.0, 0, [old], []))
    names = drawn(Period(1.0, 0, [late, old, LINK], []), order="name")
    assert names.index("-> arm") < names.index("-> base") < names.index("-> odom")


def test_what_does_not_fit_is_counted() -> None:
    links = [replace(LINK, frame=f"frame {n}") for n in range(50)]
    text = drawn(Period(1.0, 0, links, []), rows=30)
    assert text.count("map -> ") == 23
    assert "and 27 more links" in text
    assert len(text.splitlines()) <= 30


def test_names_are_no_markup() -> None:
    text = drawn(Period(1.0, 0, [replace(LINK, frame="[red]x\x1b[2J")], []))
    assert "map -> [red]x\\x1b[2J" in text


def test_the_board_without_a_terminal(robot: TransformClient, command: Run) -> None:
    ended = command("top", "--every", "0.2s", "--count", "1")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "map -> odom" in ended.stdout
    assert "wheels" in ended.stdout


def test_the_board_in_a_terminal(robot: TransformClient, in_terminal: Callable[..., str]) -> None:
    screen = in_terminal("top", "--every", "0.2s", "--count", "2")
    assert "map -> odom" in screen
    assert "\x1b[?1049h" in screen and "\x1b[?1049l" in screen  # the terminal is as it was


def test_a_board_is_no_document(command: Run) -> None:
    assert command("top", "--json").returncode == 2


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


def test_the_delay_of_a_pair(robot: TransformClient, command: Run) -> None:
    pairs = [("camera", "map"), ("base_link", "camera"), ("map", "nowhere")]
    flags = [word for pair in pairs for word in ("--pair", *pair)]
    ended = command("monitor", "--every", "0.1s", "--count", "1", "--json", *flags)
    moving, static, unknown = json.loads(ended.stdout)["pairs"]
    # This tree's stamps are 299 s ahead.
    assert -299 <= moving["least_delay_s"] <= moving["greatest_delay_s"] < 0
    assert moving["oldest_link"] in ("odom", "base_link")
    assert (static["least_delay_s"], static["problem"]) == (None, "static")
    assert unknown["problem"] == "no frame 'nowhere'"
    for name in ("monitor", "top"):
        text = command(name, "--every", "0.1s", "--count", "1", *flags).stdout
        assert re.search(r"camera <- map +-\d+\.\d{3} +-\d+\.\d{3} +(odom|base_link)", text)
        assert re.search(r"base_link <- camera +- +- +static", text)


def test_the_oldest_link_of_a_pair() -> None:
    tree = TransformTree(cache_time_s=1000.0)
    second = 10**9
    for parent, child, stamp_s in (("map", "a", 90), ("map", "b", 97), ("b", "c", 95)):
        tree.set_transform(StampedTransform(parent, child, stamp_s * second, Transform()))
    tree.set_transform(StampedTransform("other", "x", 99 * second, Transform()))
    frames = {name: tree.frame(name) for name in tree.frames()}

    def delay(target: str, source: str, *clocks_s: int) -> PairDelay:
        watch = PairWatch((target, source))
        for clock_s in clocks_s:
            watch.add(frames, clock_s * second)
        return watch.result()

    assert delay("b", "c", 100, 103) == PairDelay("b", "c", 5.0, 8.0, "c", None)
    assert delay("map", "c", 100) == PairDelay("map", "c", 5.0, 5.0, "c", None)
    assert delay("a", "c", 100).oldest_link == "a"
    assert delay("c", "c", 100).problem == "static"
    assert delay("c", "x", 100).problem == "not connected: the roots are 'map' and 'other'"
    assert delay("b", "c", 10**6).problem == "the stamps are of another clock"
