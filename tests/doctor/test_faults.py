"""Each fault that people know is named, and nothing beside it; and nothing in healthy robots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from zenoh_tf_tools.doctor import CATALOGUE, diagnose

from .faults import FAULTS, Found
from .healthy import HEALTHY, post_dated
from .ward import Robot, circle, observed


def names(robot: Robot, ignore: tuple[str, ...] = ()) -> Found:
    return {(each.fault.id, each.subject) for each in diagnose(observed(robot), ignore)}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_and_nothing_beside_it(fault: str) -> None:
    make, expected = FAULTS[fault]
    robot = Robot()
    make(robot)
    assert names(robot) == expected


def test_every_fault_of_the_catalogue_that_samples_show_is_made() -> None:
    made = {fault for _, found in FAULTS.values() for fault, _ in found}
    # Mirrors show TF108, whole messages TF401, a tree's counters TF205, and its names TF303.
    assert made | {"TF108", "TF205", "TF303", "TF401"} == {fault.id for fault in CATALOGUE}


@pytest.mark.parametrize("make", HEALTHY)
def test_nothing_is_found_in_a_healthy_robot(make: Callable[[Robot], None]) -> None:
    robot = Robot()
    make(robot)
    assert names(robot) == set()


def test_a_localisation_that_stamps_ahead_is_healthy_in_a_recording() -> None:
    """A recording has no offsets between the clocks of machines."""
    robot = Robot()
    post_dated(robot)
    facts = observed(robot)
    publishers = [
        replace(each, clock_offset_min_s=None, clock_offset_max_s=None)
        for each in facts.authorities
    ]
    assert not diagnose(replace(facts, authorities=publishers))


def test_what_was_before_the_doctor_came_is_not_reported() -> None:
    robot = Robot()
    robot.rest()
    robot.wheels()
    robot.link("odom", "base", "wheels", 10.0, circle, stamp=lambda t: t - 30, start_s=-3, end_s=-2)
    robot.link("odom", "base", "wheels", 50.0, circle, start_s=-3, end_s=-2)  # repeated stamps
    assert names(robot) == set()


def test_a_consequence_stays_hidden_if_its_cause_is_ignored() -> None:
    robot = Robot()
    make, ((fault, _),) = FAULTS["clock_ahead"]
    make(robot)
    assert names(robot, (fault,)) == set()
