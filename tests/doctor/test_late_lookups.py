"""The doctor on a real server judges a link by the lookups that it made fail or wait meanwhile."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.support import command_line
from tests.support.waiting import wait_until
from zenoh_tf import ExtrapolationException, StampedTransform, Transform
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.observations import watch
from zenoh_tf_tools.doctor import diagnose

MS = 10**6
S = 10**9


class Robot:
    """A localisation at 0.5 Hz and wheels at 5 Hz in simulated time, so that no stamp is old."""

    def __init__(self, tf: TransformClient) -> None:
        self.tf = tf
        self.newest_ns = 1000 * S
        self.publish(*range(-8, 1))

    def publish(self, *periods: int) -> None:
        """The samples of these periods of the localisation, after the beginning."""
        for period in periods:
            at_ns = self.newest_ns + period * 2 * S
            for n in range(-9, 1):
                at = StampedTransform("odom", "base", at_ns + n * 200 * MS, Transform())
                self.tf.set_transform(at, "wheels")
            self.tf.set_transform(StampedTransform("map", "odom", at_ns, Transform()), "amcl")

    def fail(self, *late_ms: int) -> None:
        for ms in late_ms:
            with pytest.raises(ExtrapolationException):
                self.tf.lookup_transform("map", "base", self.newest_ns + ms * MS)

    def wait(self, *late_ms: int) -> None:
        """Lookups that wait for the samples of the next period, and get them."""
        with ThreadPoolExecutor(len(late_ms)) as pool:
            asked = [
                pool.submit(
                    self.tf.lookup_transform,
                    "map",
                    "base",
                    self.newest_ns + ms * MS,
                    timeout_s=60,
                )
                for ms in late_ms
            ]
            wait_until(lambda: self.tf.stats()["waiters"] == len(late_ms))
            self.publish(1)
            for each in asked:
                each.result()


@pytest.fixture
def robot(client: TransformClient) -> Iterator[Robot]:
    yield Robot(client)


def found(robot: Robot, ask: Callable[[], None]) -> list[str]:
    """What is found in a time in which `ask` ran."""
    with contextlib.closing(watch(robot.tf, 0.01, 30.0)) as looks:
        next(looks)
        ask()
        facts = next(looks)
    # However long that took, the wheels did not stop.
    findings = diagnose(facts, ignore=["TF104"])
    return [f"{each.fault.id} {each.subject}: {each.evidence}" for each in findings]


def test_a_link_that_made_lookups_fail_is_too_slow(robot: Robot) -> None:
    robot.fail(50, 70)  # before the doctor comes
    (line,) = found(robot, lambda: robot.fail(70, 80, 105))
    assert line.startswith("TF107 odom: 3 lookups in ")
    assert line.endswith(
        " s asked for 'map' -> 'odom' 85 ms after its newest sample on average: "
        "3 failed, 0 waited; it is published at 0.6 Hz by 'amcl'"
    )


def test_nothing_is_found_of_what_was_before_the_doctor_came(robot: Robot) -> None:
    robot.fail(50, 70)
    robot.wait(300, 400)
    assert found(robot, lambda: None) == []


def test_a_link_that_made_lookups_wait_for_long_is_too_slow(robot: Robot) -> None:
    (line,) = found(robot, lambda: robot.wait(100, 300, 400))
    assert line.startswith("TF107 odom: 3 lookups in ")
    assert " 267 ms after its newest sample on average: 0 failed, 3 waited; " in line


def test_a_few_late_lookups_are_no_fault_of_a_link(robot: Robot) -> None:
    def ask() -> None:
        robot.fail(400)
        robot.wait(300)

    assert found(robot, ask) == []


def test_one_failure_beside_short_waits_is_no_fault_of_a_link(robot: Robot) -> None:
    def ask() -> None:
        robot.fail(70)
        robot.wait(20, 40, 60)

    assert found(robot, ask) == []


def test_to_wait_for_the_next_sample_is_usual(robot: Robot) -> None:
    assert found(robot, lambda: robot.wait(20, 40, 60)) == []


def test_questions_that_nobody_can_answer_are_no_fault_of_a_link(robot: Robot) -> None:
    def ask() -> None:
        robot.fail(12_000, 3_600_000, 10**9)
        with pytest.raises(ExtrapolationException):
            robot.tf.lookup_transform("map", "base", 1000)
        robot.tf.lookup_transform("map", "base")

    assert found(robot, ask) == []


def test_the_record_of_the_frame_says_so(robot: Robot) -> None:
    robot.fail(50, 70)
    done = command_line.run("--connect", robot.tf.endpoint, "frame", "odom")
    assert "  late         lookups: 2 failed, 0 waited" in done.stdout.splitlines()
    done = command_line.run("--connect", robot.tf.endpoint, "frame", "base")
    assert "  late  " not in done.stdout
