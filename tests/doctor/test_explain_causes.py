"""`explain` of what is easily mistaken: moves, units, clocks, times that have not come."""

from __future__ import annotations

import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf.introspection.explain import explain

from .test_explain import NOW_NS, S, explained, put, tree

__all__ = ["tree"]


def test_live_roots_are_no_misspelt_names(tree: TransformTree) -> None:
    """Not even if their names are somewhat like others."""
    put(tree, "map", "gap", 1)
    put(tree, "thing", "tool", 1)
    found = explained(tree, "map", "tool")
    assert found.reasons == (
        "'map' and 'tool' are not connected: their roots are 'map' and 'thing'.",
    )
    assert found.advice == (
        "Publish the link that joins them, such as the pose of 'thing' in a frame of the tree of "
        "'map', and check that its publisher runs.",
    )


def test_a_frame_that_has_moved_out_of_the_tree(tree: TransformTree) -> None:
    put(tree, "dock", "base", 10, authority="docking")
    found = explained(tree, "map", "camera", now_s=15)
    assert found.reasons == (
        "'map' and 'camera' are not connected: their roots are 'map' and 'dock'.",
        "'base' moved from 'odom' to 'dock' 5.0 s ago.",
    )
    # Before it moved, they were connected.
    found = explained(tree, "map", "camera", 8.5, now_s=15)
    assert found.possible
    assert found.reasons[-1] == "'base' moved from 'odom' to another parent 5.0 s ago."


def test_a_frame_that_has_moved_within_the_tree(tree: TransformTree) -> None:
    put(tree, "map", "base", 10, authority="docking")
    found = explained(tree, "map", "camera", now_s=12)
    assert found.possible
    assert found.reasons[-1] == "'base' moved from 'odom' to 'map' 2.0 s ago."
    assert "moved" not in str(explained(tree, "map", "camera", now_s=120))
    found = explained(tree, "map", "camera", now_s=10**7)
    assert found.reasons[-1] == (
        "'base' moved from 'odom' to 'map' 0 us before the newest stamp of the chain."
    )


@pytest.mark.parametrize(
    ("stamp_ns", "unit", "power"),
    [
        (NOW_NS // S + 4, "seconds", 9),
        (NOW_NS // 10**6 + 4000, "milliseconds", 6),
        (NOW_NS // 1000, "microseconds", 3),
    ],
)
def test_a_time_in_another_unit(tree: TransformTree, stamp_ns: int, unit: str, power: int) -> None:
    frames = [tree.frame(name) for name in tree.frames()]
    found = explain("map", "camera", stamp_ns, frames, (), NOW_NS + 10 * S)
    assert found.error == "BackwardExtrapolationException"
    assert found.advice == (
        f"The time asked for, {stamp_ns}, is in {unit}; times are in nanoseconds. Multiply it by "
        f"1e{power} as an integer.",
    )


def test_simulated_seconds_in_place_of_nanoseconds() -> None:
    tree = TransformTree()
    for n in range(900, 1000):
        tree.set_transform(StampedTransform("map", "base", n * S // 10, Transform()))
    assert "is in seconds" in tree.explain("map", "base", 95).advice[0]


def test_a_link_whose_clock_is_ahead() -> None:
    tree = TransformTree()
    put(tree, "map", "odom", *(n / 10 for n in range(100)), authority="amcl")
    put(tree, "odom", "base", *(11 + n / 10 for n in range(20)), authority="wheels")
    for at_s in (None, 9.95):
        found = explained(tree, "map", "base", at_s)
        assert not found.possible
        assert "The newest sample of 'odom' -> 'base' is 2.9 s ahead of the clock." in found.reasons
        assert found.advice[0] == (
            "Check the clock of 'wheels': zenoh-tf authorities shows how far the stamps of each "
            "publisher are ahead."
        )
        assert "--cache-time" not in str(found)
    put(tree, "map", "base", *(n / 10 for n in range(130)), authority="wheels")
    found = explained(tree, "map", "base", 9.9)
    assert found.possible
    assert "is 2.9 s ahead of the clock" in found.reasons[1]


def test_a_localisation_that_stamps_ahead_on_purpose() -> None:
    tree = TransformTree()
    put(tree, "map", "odom", *(1 + n / 10 for n in range(100)), authority="amcl")
    put(tree, "odom", "base", *(n / 10 for n in range(100)), authority="wheels")
    for at_s in (None, 9.95, 0.2):
        found = explained(tree, "map", "base", at_s, now_s=9.95)
        purpose = "950 ms ahead of the clock, but those of the odometry below it are not"
        assert any("'map' -> 'odom'" in each and purpose in each for each in found.reasons)
        assert not any("Check the clock" in each for each in found.advice)
    assert "If 'amcl' is no localisation, its clock is ahead" in found.advice[-1]
    assert "has a history of 9.9 s" in found.advice[0]
    put(tree, "base", "tip", *(n / 10 for n in range(110)), authority="arm")
    odometry = explained(tree, "odom", "tip", 9.95, now_s=9.95)
    assert "on purpose" not in str(odometry)


def test_a_time_that_has_not_come(tree: TransformTree) -> None:
    for now_s in (10, 60):  # also if links have stopped meanwhile
        found = explained(tree, "map", "arm", now_s + 3600, now_s=now_s)
        assert found.advice == (
            "The time asked for has not come yet: it is 60 min ahead of this machine's clock. Ask "
            "for an earlier one; if it should have come, check the clock that it is from (zenoh-tf "
            "clients, zenoh-tf authorities).",
        )
        assert "has stopped" not in str(found)
    found = explained(tree, "map", "arm", 3610, now_s=10**7)  # simulated
    assert "it is 60 min ahead of the newest stamp of the chain" in found.advice[0]
