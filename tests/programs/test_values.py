"""Times, durations and numbers, as people write and read them; every form of the page."""

from __future__ import annotations

import argparse
import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from zenoh_tf.text.flag_values import angle, length, number, size, whole
from zenoh_tf.text.time_flags import duration, live_time, recorded_time
from zenoh_tf.text.times import age, seconds
from zenoh_tf_tools.cli.output import when

S = 10**9
PAGE = (Path(__file__).parents[2] / "docs/reference/commands.md").read_text()
Parse = Callable[[str], Any]


def refused(parse: Parse, text: str) -> str:
    with pytest.raises(argparse.ArgumentTypeError) as caught:
        parse(text)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("12ns", 12),
        ("12s", 12 * S),
        (".5s", S // 2),
        ("2min", 120 * S),
        ("1.7e9s", 1_700_000_000 * S),
        ("1700000000.123456789s", 1_700_000_000_123_456_789),
        ("1700000000123456789ns", 1_700_000_000_123_456_789),
        ("2023-11-14T22:13:20Z", 1_700_000_000 * S),
        ("2023-11-14 22:13:20.123456789Z", 1_700_000_000_123_456_789),
        ("2023-11-15T00:13+02:00", 1_699_999_980 * S),
        ("1969-12-31T23:59:59.5Z", -S // 2),
    ],
)
def test_stamps(text: str, stamp_ns: int) -> None:
    assert live_time(text) == stamp_ns
    assert recorded_time(text).stamp_ns(5, 9) == stamp_ns


@pytest.mark.parametrize(
    ("text", "offset_ns"),
    [
        ("now", 0),
        ("now-2s", -2 * S),
        ("now+1min", 60 * S),
        ("now-5ns", -5),
        ("-1s", -S),
        ("+.5s", S // 2),
        ("-7ms", -7 * 10**6),
    ],
)
def test_times_from_now(text: str, offset_ns: int) -> None:
    before = time.time_ns()
    stamp_ns = live_time(text)
    assert before <= stamp_ns - offset_ns <= time.time_ns()


def test_times_from_the_ends_of_a_recording() -> None:
    assert recorded_time("+1.5s").stamp_ns(5 * S, 9 * S) == 6_500_000_000
    assert recorded_time("-250ms").stamp_ns(5 * S, 9 * S) == 8_750_000_000


@pytest.mark.parametrize(
    "text",
    ["", "s", "noon", "now2", "now2s", "now-", "1 s", "infs", "nan", "--5s", "2026-01-31", "1_0s"],
)
def test_no_times(text: str) -> None:
    assert "is not a time; give" in refused(live_time, text)
    assert "is not a time; give" in refused(recorded_time, text)


def test_a_recording_has_no_now() -> None:
    assert "is not a time; give +10s" in refused(recorded_time, "now")


def test_a_number_alone_is_refused_with_what_it_may_mean() -> None:
    assert refused(live_time, "10") == (
        "'10' is ambiguous: the stamp 10 s or the stamp 10 ns; write 10s or 10ns"
    )
    assert refused(recorded_time, "1.5") == (
        "'1.5' is ambiguous: 1.5 s after the recording's first stamp, or the stamp 1.5 s; "
        "write +1.5s or 1.5s"
    )
    readings = "'{0}' is ambiguous: {0} seconds or {0} milliseconds; write {0}s or {0}ms"
    assert refused(duration(), "10") == readings.format("10")
    assert refused(recorded_time, "-2") == readings.format("-2")
    assert refused(live_time, "now+3") == readings.format("+3")
    assert "no time zone; append Z for UTC" in refused(live_time, "2026-01-31T12:00:00")


def test_times_that_no_stamp_can_say() -> None:
    for text in ("9223372036854775808ns", "-99999999999s", "1e99d", "9999-01-01T00:00:00Z"):
        assert "too large for 64 bits of nanoseconds" in refused(live_time, text)
        assert "too large for 64 bits of nanoseconds" in refused(recorded_time, text)
    assert "month must be in" in refused(live_time, "2026-13-01T00:00:00Z")


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("20ms", 0.02), ("2s", 2.0), ("5min", 300.0), ("1h", 3600.0), ("0", 0.0), ("1us", 1e-6)],
)
def test_durations(text: str, seconds: float) -> None:
    assert duration()(text) == seconds


@pytest.mark.parametrize(
    ("parse", "text", "message"),
    [
        (duration(), "soon", "'soon' is not a duration; give 20ms, 2s or 5min"),
        (duration(), "-1s", "'-1s' is not a duration of at least 0 s and at most 1e+09 s"),
        (duration(above=True), "0", "'0' is not a duration above 0 s and at most 1e+09 s"),
        (duration(0.0, 3600.0), "2h", "is not a duration of at least 0 s and at most 3,600 s"),
        (number(), "x", "'x' is not a number"),
        (number(), "nan", "'nan' is not a number"),
        (number(0.1, 1000.0), "0", "'0' is not a number of at least 0.1 and at most 1,000"),
        (number(0.0, above=True), "0", "'0' is not a number above 0"),
        (whole(1, 65_535), "70000", "'70000' is not a whole number from 1 to 65,535"),
        (whole(0), "1.5", "'1.5' is not a whole number from 0 to 1,000,000,000"),
        (whole(0), "²", "is not a whole number"),
        (length, "2", "'2' is ambiguous: 2 metres or 2 millimetres; write 2m or 2mm"),
        (length, "-2cm", "'-2cm' is not a length; give 5mm, 2cm or 0.1m"),
        (length, "2km", "'2km' is not a length"),
        (angle(), "1°", "'1°' is not an angle; give 90deg or 1.57rad"),
        (angle(low=0.0), "-1deg", "'-1deg' is not a number of at least 0"),
        (size(1 << 20), "1K", "'1K' is not a number of bytes of at least 1,048,576, such as 512MB"),
        (size(), "1T", "'1T' is not a number of bytes of at least 1"),
    ],
)
def test_refusals(parse: Parse, text: str, message: str) -> None:
    assert message in refused(parse, text)


def test_angles() -> None:
    for text in ("90deg", "+90deg", " 90deg", "9e1deg"):
        assert angle()(text) == pytest.approx(math.pi / 2)
    assert [angle()(text) for text in ("0", "-0.5rad", ".5rad")] == [0.0, -0.5, 0.5]
    assert angle(bare=True)("1.5708") == 1.5708
    assert angle(bare=True)("-180deg") == pytest.approx(-math.pi)
    assert refused(angle(), "90") == (
        "'90' is ambiguous: 90 degrees or 90 radians; write 90deg or 90rad"
    )
    for text in ("", "deg", "90 deg", "nan", "infdeg", "90grad"):
        assert "is not an angle; give 90deg or 1.57rad" in refused(angle(), text)
    assert "is not a number" in refused(angle(), "1e999deg")


def test_numbers() -> None:
    assert number()("-1e-3") == -0.001
    assert whole(1)("7") == 7
    assert [length(text) for text in ("5mm", "2cm", "0.1m", "0")] == [0.005, 0.02, 0.1, 0.0]
    assert [angle()(text) for text in ("180deg", "20mrad", "0.1rad")] == [math.pi, 0.02, 0.1]
    assert [size()(text) for text in ("512", "1K", "512MB", "4g")] == [512, 1024, 1 << 29, 4 << 30]


def test_the_page_has_only_what_can_be_read() -> None:
    """Its table has the forms in code; the first column says of what."""
    section = PAGE.partition("## Times, durations and numbers\n")[2].partition("\n## ")[0]
    parsers = {
        "time": (live_time, recorded_time),
        "time of a running tree": (live_time,),
        "time of a recording": (recorded_time,),
        "duration": (duration(),),
        "length": (length,),
        "angle": (angle(),),
        "number": (number(),),
        "whole number": (whole(0),),
        "bytes": (size(),),
    }
    seen = set()
    for kind, forms in re.findall(r"^\| ([a-z ]+) \| (.*?) \|", section, re.MULTILINE):
        if kind in parsers:
            seen.add(kind)
            for form in re.findall(r"`([^`]+)`", forms):
                for parse in parsers[kind]:
                    parse(form)
    assert seen == set(parsers)


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
