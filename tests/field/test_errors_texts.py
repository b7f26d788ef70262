"""Errors that people could not act on: stamps in another unit, links that ended, names misspelt.

ros2/geometry2#38, ros/geometry2#563, ANYbotics/elevation_mapping#122,
RobustFieldAutonomyLab/LeGO-LOAM#230, ros-perception/image_pipeline#293."""

from __future__ import annotations

import re
import time
import warnings

import pytest

from tests.processes.servers import ServerProcess
from zenoh_tf import (
    BackwardExtrapolationException,
    ExtrapolationException,
    ForwardExtrapolationException,
    GapTooLong,
    InvalidArgumentException,
    LookupException,
    StampedTransform,
    Transform,
    TransformException,
    TransformTree,
)

S = 10**9
#: Of 2023: stamps of a real clock need not be of now.
PAST_NS = 1_700_000_000 * S


def put(tree: TransformTree, parent: str, child: str, *stamps_ns: int, who: str = "") -> None:
    for stamp_ns in stamps_ns:
        tree.set_transform(StampedTransform(parent, child, stamp_ns, Transform((1, 0, 0))), who)


def put_static(tree: TransformTree, parent: str, child: str, who: str) -> None:
    tree.set_transform(StampedTransform(parent, child, 0, Transform()), who, static=True)


def moving(newest_ns: int, parent: str = "map", child: str = "base") -> TransformTree:
    """A link with a sample every 0.1 s for 2 s."""
    tree = TransformTree()
    put(tree, parent, child, *(newest_ns - n * S // 10 for n in range(20, -1, -1)))
    return tree


@pytest.mark.parametrize("newest_ns", [PAST_NS, PAST_NS + 90_000_000_123_456_789])
@pytest.mark.parametrize(
    ("unit", "power"), [("seconds", 9), ("milliseconds", 6), ("microseconds", 3)]
)
def test_a_lookup_in_another_unit(newest_ns: int, unit: str, power: int) -> None:
    """ros2/geometry2#38: a stamp lost its nanoseconds where it was converted."""
    stamp_ns = newest_ns // 10**power
    with pytest.raises(BackwardExtrapolationException) as caught:
        moving(newest_ns).lookup_transform("map", "base", stamp_ns)
    assert f"{stamp_ns} ns is" in str(caught.value)
    assert f"looks like {unit}: stamps are integer nanoseconds" in str(caught.value)


@pytest.mark.parametrize("power", [9, 6])
def test_a_publisher_in_another_unit(power: int) -> None:
    now_ns = time.time_ns() | 1
    tree = moving(now_ns)
    with pytest.warns(UserWarning, match="the stamp of 'arm' is .* after 1970, and looks like"):
        put(tree, "base", "arm", now_ns // 10**power | 1)
    for stamp_ns in (None, now_ns):
        with pytest.raises(TransformException, match="after 1970, and looks like"):
            tree.lookup_transform("map", "arm", stamp_ns)


@pytest.mark.parametrize("newest_ns", [3_235_000_000, 1_795 * S, 40 * 86_400 * S])
def test_simulated_time_is_no_other_unit(newest_ns: int) -> None:
    """ANYbotics/elevation_mapping#122: a clock of 1574652168 s beside simulated 3.235 s."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tree = moving(newest_ns)
    for stamp_ns in (newest_ns - 30 * S, newest_ns + 30 * S, 1_574_652_168_590_749_000):
        with pytest.raises(TransformException) as caught:
            tree.lookup_transform("map", "base", stamp_ns)
        assert "looks like" not in str(caught.value)


@pytest.mark.parametrize(("moved", "behind_s"), [("camera", 8), ("imu_link", 3600)])
def test_a_static_link_that_was_sent_as_moving(moved: str, behind_s: int) -> None:
    """RobustFieldAutonomyLab/LeGO-LOAM#230: static links were sent on /tf, stamped once."""
    now_ns = time.time_ns()
    tree = moving(now_ns, "odom", "base")
    put_static(tree, "base", moved, "driver")
    put(tree, "base", moved, now_ns - behind_s * S, who="first.py")
    with pytest.raises(BackwardExtrapolationException) as caught:
        tree.lookup_transform("odom", moved)
    text = str(caught.value)
    assert f"the link from 'base' to '{moved}' has no sample after" in text
    assert "too early" not in text
    assert re.search(r"which is [\d.]+ (s|min) ago and [\d.]+ (s|min) before", text)
    assert text.endswith("it was static until 'first.py' sent it as moving")
    assert caught.value.frame == moved
    found = tree.explain("odom", moved)
    assert found.limiting_frame == moved
    assert any("was static until" in reason for reason in found.reasons)


@pytest.mark.parametrize("early_ns", [206_000, 3 * S])
def test_a_lookup_without_a_time_at_start_up(early_ns: int) -> None:
    """ros/geometry2#563: one node began 0.2 ms after the only sample of the other."""
    tree = TransformTree()
    begin_ns = 1_717_586_838_886_000_000
    put(tree, "work", "g4_body", begin_ns - early_ns)
    put(tree, "map", "work", begin_ns, begin_ns + S)
    with pytest.raises(BackwardExtrapolationException) as caught:
        tree.lookup_transform("map", "g4_body")
    assert "have no time in common: the link from 'work' to 'g4_body'" in str(caught.value)
    assert "too early" not in str(caught.value)


def test_a_lookup_of_now_names_the_wait() -> None:
    """ros-perception/image_pipeline#293: the cure is a time-out."""
    tree = moving(PAST_NS)
    with pytest.raises(ForwardExtrapolationException, match=r"\(50 ms too late\); give the"):
        tree.lookup_transform("map", "base", PAST_NS + 50_000_000)
    with pytest.raises(ForwardExtrapolationException, match=r"too late, waited for 10 ms\)$"):
        tree.lookup_transform("map", "base", PAST_NS + 50_000_000, timeout_s=0.01)
    with pytest.raises(BackwardExtrapolationException, match=r"\(50\.0 s too early\)$"):
        tree.lookup_transform("map", "base", PAST_NS - 52 * S)


def test_names_that_may_be_meant(server: ServerProcess) -> None:
    """One text for the embedded tree, the server's memory, and a query of it."""
    tree = moving(PAST_NS, "map", "camera")
    with server.connect() as tf, server.connect(reads="shared") as shared:
        tf.set_transform(StampedTransform("map", "camera", PAST_NS, Transform()))
        for reader in (tree, tf, shared):
            with pytest.raises(LookupException) as caught:
                reader.lookup_transform("map", "camra")
            assert str(caught.value) == "frame 'camra' does not exist; did you mean 'camera'?"
            with pytest.raises(LookupException) as caught:
                reader.lookup_transform("Map", "camera", timeout_s=0.01)
            assert re.search(r"\(waited for \d+ ms\); did you mean 'map'\?$", str(caught.value))
            for method in (reader.frame, reader.parent, reader.remove_frame):
                with pytest.raises(LookupException, match=r"; did you mean 'camera'\?$"):
                    method("Camera")
            with pytest.raises(ExtrapolationException, match=r"late\); give the lookup a time-out"):
                reader.lookup_transform("map", "camera", PAST_NS + S)


@pytest.mark.parametrize(("samples", "step_ns"), [(4, 1_000_000), (20, 5_000_000)])
def test_samples_of_one_transaction_show_no_rate(samples: int, step_ns: int) -> None:
    """Four of them were 1283.8 Hz for hours, and then a publisher that has stopped."""
    tree = TransformTree()
    begin_ns = time.time_ns() - 3600 * S
    rows = [
        StampedTransform("map", "arm", begin_ns + n * step_ns, Transform()) for n in range(samples)
    ]
    tree.set_transforms_xact(rows, "planner")
    info = tree.frame("arm")
    assert info.rate_hz is None
    assert repr(info).startswith(
        f"<FrameInfo 'arm' in 'map', newest_stamp_ns={rows[-1].stamp_ns}, "
    )
    assert " Hz" not in str(tree.explain("map", "arm"))
    assert moving(begin_ns).frame("base").rate_hz == pytest.approx(10, rel=0.1)


# --- texts that named the fault badly


def test_what_would_close_a_cycle_says_who_is_below_whom() -> None:
    tree = TransformTree()
    put(tree, "a", "b", S)
    put(tree, "b", "c", S)
    with pytest.raises(InvalidArgumentException, match="close a cycle: 'c' is below 'a'"):
        put(tree, "c", "a", S)


@pytest.mark.parametrize("field", ["translation", "rotation"])
def test_a_value_that_is_no_number_is_of_a_field(field: str) -> None:
    values = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0)}
    values[field] = (float("nan"), *values[field][1:])
    pose = Transform(**values)
    with pytest.raises(InvalidArgumentException, match=f"a value of the {field} is NaN"):
        TransformTree().set_transform(StampedTransform("map", "base", S, pose))


def test_a_gap_is_neither_early_nor_late() -> None:
    tree = TransformTree()
    put(tree, "map", "base", S, 3 * S)
    with pytest.raises(GapTooLong) as caught:
        tree.lookup_transform("map", "base", 2 * S, max_gap_s=0.5)
    assert str(caught.value).endswith("was requested to look up 'base' in 'map'")


def test_how_far_an_estimate_may_go_is_in_seconds() -> None:
    with pytest.raises(ForwardExtrapolationException, match=r"at most 0\.5 s \(max_by_s\)"):
        moving(PAST_NS).estimate_transform("map", "base", PAST_NS + 9 * S, max_by_s=0.5)
