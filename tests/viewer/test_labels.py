"""Names that do not hide each other."""

from __future__ import annotations

import numpy as np

from zenoh_tf_tools.viewer.labels import MAX_LABELS, choose


def chosen(
    pixels: list[tuple[float, float]], rank: list[int], drawn: list[bool] | None = None
) -> list[int]:
    count = len(pixels)
    return [
        *choose(
            np.array(pixels, float).reshape(-1, 2),
            np.array(rank, int),
            np.full(count, 10, int),
            np.array(drawn or [False] * count, bool),
            1600,
        )
    ]


def test_the_most_important_of_those_that_overlap() -> None:
    assert chosen([(100, 100), (110, 105), (105, 95)], [1, 3, 2]) == [1]
    assert chosen([(100, 100), (110, 200), (300, 95)], [1, 3, 2]) == [1, 2, 0]


def test_names_that_are_not_to_be_drawn() -> None:
    assert chosen([(100, 100), (300, 100)], [0, 1]) == [1]
    assert chosen([], []) == []


def test_names_do_not_flicker() -> None:
    """Of two that are equally important, the one that is there stays."""
    places: list[tuple[float, float]] = [(100, 100), (110, 105)]
    assert chosen(places, [1, 1]) == [0]
    assert chosen(places, [1, 1], [False, True]) == [1]


def test_a_name_does_not_leave_the_window() -> None:
    """At its right end it is written to the left, where it needs room as well."""
    pixels = np.array([[780.0, 100], [100, 100], [760, 105]])
    found = choose(pixels, np.array([2, 1, 1]), np.full(3, 10), np.zeros(3, bool), 800)
    assert found == {0: "bottom-right", 1: "bottom-left"}


def test_no_two_of_a_thousand_overlap() -> None:
    chance = np.random.default_rng(7)
    pixels = chance.uniform((0, 0), (1600, 900), (1000, 2))
    lengths = chance.integers(1, 30, 1000)
    rows = [*choose(pixels, np.ones(1000, int), lengths, np.zeros(1000, bool), 1600)]
    assert 20 < len(rows) <= MAX_LABELS
    down = np.abs(pixels[rows, None, 1] - pixels[None, rows, 1])
    across = np.abs(pixels[rows, None, 0] - pixels[None, rows, 0])
    near = (down < 12) & (across < 5) & ~np.eye(len(rows), dtype=bool)
    assert not near.any()
