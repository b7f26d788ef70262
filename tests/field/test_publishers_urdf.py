"""Robots of the field whose joints mimic others: google-deepmind/mujoco#3527 and
ekorudiawan/rg2_simulation#2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.support import command_line
from zenoh_tf import InvalidArgumentException
from zenoh_tf.urdf import reader
from zenoh_tf.urdf.kinematics import JointTransforms


def robot(*joints: str) -> bytes:
    """A robot whose joints all hang on ``base``; each is ``name kind`` and the rest of its XML."""
    text = ['<robot name="r"><link name="base"/>']
    for spec in joints:
        name, kind, *more = spec.split(" ", 2)
        text.append(
            f'<link name="{name}_link"/><joint name="{name}" type="{kind}"><parent link="base"/>'
            f'<child link="{name}_link"/>{more[0] if more else ""}</joint>'
        )
    return "".join([*text, "</robot>"]).encode()


def mimic(joint: str, multiplier: float = 1.0, offset: float = 0.0) -> str:
    return f'<mimic joint="{joint}" multiplier="{multiplier}" offset="{offset}"/>'


def slides(
    joints: JointTransforms, names: Sequence[str], positions: Sequence[float]
) -> dict[str, float]:
    """Positions of sliding joints, as the transforms have them, by joint."""
    moved = joints.move(names, np.array(positions), 1)
    children = [moved.names[child].removesuffix("_link") for child in moved.child]
    return dict(zip(children, moved.pose[:, 0].tolist(), strict=True))


@pytest.mark.parametrize("q", [0.0, 0.05])
@pytest.mark.parametrize("o", [-0.01, 0, 0.02, 0.05])
@pytest.mark.parametrize("m", [-1, 1, 0.5, 2])
def test_a_chain_composes_with_both_offsets(q: float, m: float, o: float) -> None:
    """google-deepmind/mujoco#3527; one follower stands before its leader in the file."""
    joints = JointTransforms(
        reader.parse(
            robot(
                f"f2 prismatic {mimic('f1', 3.0, 0.25)}",
                "driver prismatic",
                f"f1 prismatic {mimic('driver', m, o)}",
            )
        )
    )
    first = m * q + o
    expected = {"driver": q, "f1": first, "f2": 3.0 * first + 0.25}
    assert slides(joints, ["driver"], [q]) == pytest.approx(expected)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_follower_that_is_no_number_is_computed_from_its_leader(bad: float) -> None:
    """google-deepmind/mujoco#3527: the driver is known, so its followers are."""
    joints = JointTransforms(
        reader.parse(
            robot(
                "driver prismatic",
                f"f1 prismatic {mimic('driver', 2.0, 0.1)}",
                f"f2 prismatic {mimic('f1', -1.0)}",
            )
        )
    )
    got = slides(joints, ["f1", "driver"], [bad, 0.5])
    assert got == pytest.approx({"driver": 0.5, "f1": 1.1, "f2": -1.1})
    assert (joints.counts.not_numbers, joints.first) == (1, {"not_numbers": "f1"})
    # A leader that is no number moves nothing, but its follower may speak for itself.
    assert slides(joints, ["driver", "f1"], [bad, 0.3]) == pytest.approx({"f1": 0.3, "f2": -0.3})
    assert slides(joints, ["driver"], [bad]) == {}


LOST = {
    "misspelt": ("left_knuckel", "does not exist", "did you mean 'left_knuckle'?"),
    "renamed": ("gripper_joint", "does not exist", ""),
    "fixed": ("mount", "is fixed", ""),
    "floating": ("free", "is floating", ""),
}


@pytest.mark.parametrize("name", LOST)
def test_a_mimic_of_a_joint_that_cannot_lead_is_skipped(name: str) -> None:
    """ekorudiawan/rg2_simulation#2: the rest of the gripper loads and moves."""
    target, reason, hint = LOST[name]
    found = reader.parse(
        robot(
            f"finger prismatic {mimic(target)}",
            "left_knuckle prismatic",
            "mount fixed",
            "free floating",
            f"tip prismatic {mimic('finger', 2.0)}",
        ),
        "gripper.urdf",
    )
    [warning] = found.warnings
    assert f"gripper.urdf: joint 'finger': it mimics '{target}', which {reason}" in warning
    assert hint in warning
    joints = JointTransforms(found)
    assert slides(joints, ["left_knuckle"], [0.2]) == {"left_knuckle": 0.2}
    assert slides(joints, ["finger"], [0.2]) == {"finger": 0.2, "tip": 0.4}


def test_the_command_prints_the_warning(tmp_path: Path) -> None:
    """ekorudiawan/rg2_simulation#2, as a user sees it."""
    path = tmp_path / "rg2.urdf"
    path.write_bytes(robot("a prismatic", *(f"f{n} prismatic {mimic('no')}" for n in range(12))))
    done = command_line.run("urdf", str(path), "--print")
    assert done.returncode == 0
    lines = done.stderr.splitlines()
    assert len(lines) == 11
    assert "joint 'f0': it mimics 'no', which does not exist; its <mimic> is ignored" in lines[0]
    assert lines[-1] == "zenoh-tf: and 2 more joints like these"
    assert "13 joints that move" in done.stdout


@pytest.mark.parametrize("order", [1, -1], ids=["leaders first", "followers first"])
def test_a_long_chain_of_mimics_costs_no_more_than_its_length(order: int) -> None:
    """20,000 joints in a chain are read and moved at once; step by step they would be 200
    million."""
    count = 20_000
    specs = ["j0 prismatic"]
    specs += [f"j{n} prismatic {mimic(f'j{n - 1}', -1.0, 0.5)}" for n in range(1, count)]
    text = robot(*specs[::order])
    joints = JointTransforms(reader.parse(text))
    got = slides(joints, ["j0"], [0.1])
    assert len(got) == count
    assert [got["j1"], got["j19998"]] == pytest.approx([0.4, 0.1])


def test_a_circle_of_mimics_is_still_refused() -> None:
    """It has no driver, so no joint of it can be computed."""
    specs = [f"j{n} prismatic {mimic(f'j{(n + 1) % 5}')}" for n in range(5)]
    with pytest.raises(InvalidArgumentException, match="it mimics itself"):
        reader.parse(robot("driver prismatic", *specs))
