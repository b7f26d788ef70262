"""What the command line reads and writes, without a server."""

from __future__ import annotations

import argparse
import io
import math
import time
from typing import Any

import pytest

from zenoh_tf import FrameInfo
from zenoh_tf_client.cli import stamps
from zenoh_tf_client.cli.drawing import draw
from zenoh_tf_client.cli.output import Palette, roll_pitch_yaw

PLAIN = Palette(io.StringIO())


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("12", 12),
        ("-12", -12),
        ("12ns", 12),
        ("12s", 12_000_000_000),
        ("1.5", 1_500_000_000),
        (".5", 500_000_000),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
    ],
)
def test_stamps(text: str, stamp_ns: int) -> None:
    assert stamps.parse(text) == stamp_ns


@pytest.mark.parametrize(
    ("text", "offset_ns"), [("now", 0), ("now-2s", -(2 * 10**9)), ("now+1", 10**9), ("now-5ns", -5)]
)
def test_stamps_from_now(text: str, offset_ns: int) -> None:
    before = time.time_ns()
    stamp_ns = stamps.parse(text)
    assert before <= stamp_ns - offset_ns <= time.time_ns()


@pytest.mark.parametrize("text", ["", "s", "noon", "1e3", "now2", "1 s", "inf", "nan", "--5"])
def test_no_stamps(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="not a time"):
        stamps.parse(text)


@pytest.mark.parametrize(
    ("age_ns", "text"),
    [
        (850_000, "850 us"),
        (12_400_000, "12 ms"),
        (3_440_000_000, "3.4 s"),
        (300 * 10**9, "5 min"),
        (7200 * 10**9, "2.0 h"),
        (-5_000_000, "-5 ms"),
    ],
)
def test_ages(age_ns: int, text: str) -> None:
    assert stamps.age(age_ns) == text


def test_seconds_lose_no_digit() -> None:
    assert stamps.seconds(1_700_000_000_123_456_789) == "1700000000.123456789"
    assert stamps.seconds(-1) == "-0.000000001"


def link(frame: str, parent: str | None, **facts: Any) -> FrameInfo:
    counters = ("rewritten", "dropped", "evicted", "reparented", "switched", "authority_changes")
    known = {
        "authority": "me" if parent else "",
        "static": False,
        "samples": 10 if parent else 0,
        "oldest_stamp_ns": -1_000_000_000 if parent else None,
        "newest_stamp_ns": 0 if parent else None,
        "version": 2,
        **dict.fromkeys(counters, 0),
    }
    return FrameInfo(name=frame, parent=parent, **{**known, **facts})


def test_drawing() -> None:
    links = [
        link("b", "root"),
        link("root", None),
        link("c", "b", static=True),
        link("a", "root"),
        link("d", "b"),
        link("other", None),
    ]
    assert draw(links, 12_000_000, PLAIN) == [
        "other",
        "root",
        "├─ a      12 ms  10.0 Hz  me",
        "└─ b      12 ms  10.0 Hz  me",
        "   ├─ c  static           me",
        "   └─ d   12 ms  10.0 Hz  me",
    ]


def test_drawing_a_link_whose_parent_is_unknown() -> None:
    assert draw([link("a", "gone")], 0, PLAIN)[0].startswith("a ")


def test_names_cannot_command_the_terminal() -> None:
    (_, line) = draw([link("root", None), link("a\x1b[2J\n", "root")], 0, PLAIN)
    assert line.startswith("└─ a\\x1b[2J\\n  ")
    (_, line) = draw([link("root", None), link("møbel 机", "root")], 0, PLAIN)
    assert line.startswith("└─ møbel 机  ")


def test_drawing_a_very_long_chain() -> None:
    links = [link("0", None)]
    links += [link(str(i), str(i - 1)) for i in range(1, 2000)]
    assert len(draw(links, 0, PLAIN)) == 2000


def test_roll_pitch_yaw() -> None:
    half = math.sqrt(0.5)
    assert roll_pitch_yaw((0, 0, half, half)) == pytest.approx((0, 0, math.pi / 2))
    assert roll_pitch_yaw((half, 0, 0, half)) == pytest.approx((math.pi / 2, 0, 0))
    # Straight up, where rounding may take the sine past 1.
    assert roll_pitch_yaw((0, half + 1e-16, 0, half))[1] == pytest.approx(math.pi / 2)
