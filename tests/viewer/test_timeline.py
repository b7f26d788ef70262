"""When frames that have a fault had samples, and the date of the time that is shown."""

from __future__ import annotations

import re

from zenoh_tf_tools.viewer.controls.figures import when_html
from zenoh_tf_tools.viewer.controls.timeline import timeline_html

S = 10**9
CLOCK_NS = 1_700_000_008 * S + 250_000_000


def lines(text: str) -> list[tuple[float, float]]:
    """Where its parts begin, and how long they are, in percent; the cursor is the last one."""
    found = re.findall(r"left:([\d.]+)%;width:max\(2px,([\d.]+)%\)", text)
    return [(float(left), float(width)) for left, width in found]


def test_a_line_shows_where_a_frame_has_samples() -> None:
    text = timeline_html(
        (10 * S, 20 * S), 18 * S, {"<lidar>": [(10 * S, 12 * S), (14 * S, 16 * S)]}
    )
    assert lines(text) == [(0, 20), (40, 20), (80, 0)]
    assert "&lt;lidar&gt;" in text


def test_nothing_without_faults_and_a_moment() -> None:
    assert timeline_html((0, S), 0, {}) == ""
    assert lines(timeline_html((S, S), S, {"a": [(S, S)]})) == [(0, 0), (0, 0)]


def test_it_is_bounded() -> None:
    many = {f"f{number}": [(n * S, n * S) for n in range(1000)] for number in range(20)}
    text = timeline_html((0, 1000 * S), 0, many)
    assert "and 14 more" in text
    assert len(lines(text)) == 6 * 50 + 1
    assert len(text) < 50_000


def test_the_date_and_the_age() -> None:
    text = when_html(CLOCK_NS, CLOCK_NS + 90 * S)
    assert "2023-11-14 22:13:28.250 UTC" in text
    assert "90.0 s ago" in text
    assert "1700000008.250 s" in text
    assert "ago" not in when_html(CLOCK_NS, CLOCK_NS + 1)
    assert "ago" not in when_html(CLOCK_NS, CLOCK_NS - 90 * S)


def test_the_time_of_a_simulation_has_no_date() -> None:
    assert when_html(12 * S, CLOCK_NS) == "at 12.000 s"
    assert "UTC" not in when_html(2**63 - 1, CLOCK_NS)
