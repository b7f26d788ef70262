"""What the command line reads and writes, without a server."""

from __future__ import annotations

import math
import re
import time

import pytest

from zenoh_tf.text.times import age, seconds
from zenoh_tf_tools.cli.output import roll_pitch_yaw, when


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
    assert age(age_ns) == text


def test_when_says_on_which_side_of_now_a_stamp_is() -> None:
    now_ns = time.time_ns()
    assert re.search(r"  \(4.. ms ago\)$", when(now_ns - 4 * 10**8))
    assert re.search(r"  \(in 9.. ms\)$", when(now_ns + 999_000_000))
    assert when(10**9) == "1.000000000 s"  # not of this machine's clock


def test_seconds_lose_no_digit() -> None:
    assert seconds(1_700_000_000_123_456_789) == "1700000000.123456789"
    assert seconds(-1) == "-0.000000001"


def test_roll_pitch_yaw() -> None:
    half = math.sqrt(0.5)
    assert roll_pitch_yaw((0, 0, half, half)) == pytest.approx((0, 0, math.pi / 2))
    assert roll_pitch_yaw((half, 0, 0, half)) == pytest.approx((math.pi / 2, 0, 0))
    # Straight up, where rounding may take the sine past 1.
    assert roll_pitch_yaw((0, half + 1e-16, 0, half))[1] == pytest.approx(math.pi / 2)
