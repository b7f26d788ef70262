"""What the command line reads and writes, without a server."""

from __future__ import annotations

import re
import time

import pytest

from zenoh_tf.text.times import age, seconds
from zenoh_tf_tools.cli.output import when


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
