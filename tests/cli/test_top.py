"""``zenoh-tf top``: the board, in a terminal and without one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.show.rates import AuthorityRate, LinkRate, Period
from zenoh_tf_tools.cli.show.top import _board

from .conftest import Run

rich_console = pytest.importorskip("rich.console")

LINK = LinkRate("odom", "map", "amcl", 10.0, 10.1, 0.1, 0.2, False)
AUTHORITY = AuthorityRate("amcl", 10.0, 10.0, 0, 0, -0.1)


def drawn(period: Period, order: str = "age", rows: int = 100, **console: Any) -> str:
    """The board as text."""
    out = rich_console.Console(width=120, **console)
    with out.capture() as capture:
        out.print(_board("main", period, order, rows))
    return str(capture.get())


def test_the_board_has_links_and_publishers() -> None:
    text = drawn(Period(1.0, 4, [LINK], [AUTHORITY]))
    assert "tree 'main': 1 dynamic and 4 static links, 1 publishers" in text
    assert "map -> odom" in text and "10.1" in text and "0.200" in text
    assert "stopped" not in text


def test_stopped_links_come_first_and_in_red() -> None:
    old = replace(LINK, frame="arm", stopped=True, greatest_age_s=1.0)
    late = replace(LINK, frame="base", greatest_age_s=5.0)
    text = drawn(Period(1.0, 0, [LINK, late, old], []))
    assert text.index("-> arm") < text.index("-> base") < text.index("-> odom")
    assert "1 stopped" in text
    assert "\x1b[1;31m" in drawn(
        Period(1.0, 0, [old], []), force_terminal=True, color_system="standard"
    )
    names = drawn(Period(1.0, 0, [late, old, LINK], []), order="name")
    assert names.index("-> arm") < names.index("-> base") < names.index("-> odom")


def test_what_does_not_fit_is_counted() -> None:
    links = [replace(LINK, frame=f"frame {n}") for n in range(50)]
    text = drawn(Period(1.0, 0, links, []), rows=30)
    assert text.count("map -> ") == 20
    assert "and 30 more links" in text
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


def test_the_board_without_its_library(command: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rich.console", None)
    ended = command("top")
    assert (ended.returncode, ended.stdout) == (1, "")
    assert "pip install 'zenoh-tf[top]'" in ended.stderr
    assert command("top", "--json").returncode == 2
