"""The doctor on the messages of a recording."""

from __future__ import annotations

from tests.support.recorded import RUN, needs_recording
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings import open_recording
from zenoh_tf_tools.doctor import RecordedFacts, diagnose

S = 10**9
Q = (0.0, 0.0, 0.0, 1.0)


Row = tuple[str, str, float, tuple[float, ...]]


def columns(*rows: Row) -> TransformRows:
    """Rows of parent, child, stamp in seconds and quaternion."""
    return TransformRows.of_tuples(
        (parent, child, round(stamp_s * S), (0.0, 0.0, 0.0, *turn))
        for parent, child, stamp_s, turn in rows
    )


def drive() -> RecordedFacts:
    """20 s of a healthy robot at 20 Hz."""
    facts = RecordedFacts()
    facts.add(0, "/tf_static", True, columns(("base", "camera", 0, Q), ("base", "lidar", 0, Q)))
    for n in range(400):
        at_s = n / 20
        rows = columns(("map", "odom", at_s, Q), ("odom", "base", at_s, Q))
        facts.add(round(at_s * S), "/tf", False, rows)
    return facts


def found(facts: RecordedFacts) -> list[tuple[str, str]]:
    return [(finding.fault.id, finding.subject) for finding in diagnose(facts.facts())]


def test_a_healthy_recording() -> None:
    facts = drive()
    assert found(facts) == []
    assert facts.facts().observed_s == 19.95


def test_quaternions_that_are_not_of_length_1() -> None:
    facts = drive()
    facts.add(20 * S, "/tf", False, columns(("odom", "base", 20, (0, 0, 0, 1.004))))
    (finding,) = diagnose(facts.facts())
    assert (finding.fault.id, finding.subject) == ("TF401", "base")
    assert finding.evidence == "the norm of a quaternion is 0.0040 off 1"


def test_transforms_that_no_tree_accepts() -> None:
    """The others of their message count."""
    facts = drive()
    rows = columns(("odom", "base", 20, Q), ("base", "arm", 20, (0, 0, 0, 0)))
    facts.add(20 * S, "/tf", False, rows)
    (finding,) = diagnose(facts.facts())
    assert (finding.fault.id, finding.subject) == ("TF106", "/tf")
    assert "1 of its transforms were refused" in finding.evidence
    assert "quaternion" in finding.evidence
    assert facts.facts().frames["base"].newest_stamp_ns == 20 * S


def test_gaps_and_links_that_have_stopped() -> None:
    facts = drive()
    for n in range(460, 600):
        rows = columns(("odom", "base", n / 20, Q))
        facts.add(round(n / 20 * S), "/tf", False, rows)
    assert found(facts) == [("TF104", "odom"), ("TF105", "base")]
    evidence = [finding.evidence for finding in diagnose(facts.facts())]
    assert evidence[0].startswith("no sample has come for 10.0 s; they came at 20.1 Hz")
    assert evidence[1].startswith("no sample came for 3.0 s, although they come at 20.0 Hz")


def test_a_gap_of_all_links_has_one_line() -> None:
    facts = drive()
    for n in range(471, 600):
        rows = columns(("map", "odom", n / 20, Q), ("odom", "base", n / 20, Q))
        facts.add(round(n / 20 * S), "/tf", False, rows)
    (finding,) = diagnose(facts.facts())
    assert (finding.fault.id, finding.subject) == ("TF105", "base")
    assert finding.evidence.startswith("no sample came for 3.6 s, although they come at 20.0 Hz")
    assert "all fast links paused at once, so look at the publishers' machine" in finding.evidence


def test_static_links_that_are_dynamic_too_and_repeated_stamps() -> None:
    facts = drive()
    facts.add(20 * S, "/tf", False, columns(("base", "lidar", 20, Q)))
    for _ in range(9):
        facts.add(20 * S, "/tf", False, columns(("odom", "base", 19.95, Q)))
    assert found(facts) == [("TF103", "lidar"), ("TF203", "base")]


def test_a_frame_that_flips_between_parents() -> None:
    facts = drive()
    for n in range(400, 420):
        rows = columns(("map" if n % 2 else "odom", "base", n / 20, Q))
        facts.add(round(n / 20 * S), "/tf", False, rows)
    assert found(facts) == [("TF102", "base")]


def test_an_empty_recording() -> None:
    assert found(RecordedFacts()) == []


@needs_recording
def test_nothing_is_found_in_the_recorded_run() -> None:
    """Its simulator stood still for more than a second, and all links with it."""
    facts = RecordedFacts()
    with open_recording(RUN) as recording:
        for message in recording.messages():
            facts.add(message.log_ns, message.topic, message.static, message.rows)
    assert found(facts) == []
