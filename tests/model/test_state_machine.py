"""The tree and the oracle side by side, driven by Hypothesis.

The random histories find more in the same time. Hypothesis draws values off the grid, and shrinks
what it finds to the shortest sequence of calls that shows a difference.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from tests.support.concurrency import FRAME_LOCKS
from zenoh_tf import TransformTree

from .calls import Call, ask, same
from .oracle import Oracle, Row
from .poses import Pose

Concurrency = Literal["optimistic", "2pl"]

CACHE_NS = 1000
MAX_DEPTH = 2

NAMES = ["map", "base", "arm", "tool"]
frames = st.sampled_from(NAMES)
asked = frames | frames | frames | st.sampled_from(["nowhere", "", "/map"])
# On a grid, so that they repeat and interleave; or any 64-bit value.
grid = st.integers(-8, 12).map(lambda step: step * 100)
stamps = grid | grid | grid | st.integers(-800, 1200) | st.integers(-(2**63) + 1, 2**63 - 1)
PROBES = [*range(-850, 1300, 50), 1, -(2**63) + 1, 2**63 - 1]
times = st.none() | stamps
metres = st.floats(-1e3, 1e3)


def _rotation(axis: tuple[float, float, float], angle: float) -> tuple[float, float, float, float]:
    x, y, z = axis
    norm = math.sqrt(x * x + y * y + z * z)
    if norm < 1e-3:
        return (0.0, 0.0, 0.0, 1.0)
    s = math.sin(angle / 2) / norm
    return (x * s, y * s, z * s, math.cos(angle / 2))


axes = st.tuples(*[st.floats(-1, 1)] * 3)
rotations = st.builds(_rotation, axes, st.floats(-6, 6) | st.floats(-1e-3, 1e-3))
poses: st.SearchStrategy[Pose] = st.builds(
    lambda x, y, z, q: (x, y, z, *q), metres, metres, metres, rotations
)
# Mostly links that form a tree, so that few writes are rejected as cycles.
usual = st.sampled_from([("map", "base"), ("base", "arm"), ("arm", "tool"), ("map", "arm")])
links = usual | usual | usual | st.tuples(frames, frames)
spoilt = st.sampled_from([1.0] * 8 + [1.004, 1.006, 0.0, math.nan])


def _row(link: tuple[str, str], stamp_ns: int, pose: Pose, by: float) -> Row:
    x, y, z, *rotation = pose
    qx, qy, qz, qw = (by * v for v in rotation)
    return Row(*link, stamp_ns, (x, y, z, qx, qy, qz, qw))


rows = st.builds(_row, links, stamps, poses, spoilt)
rarely = st.sampled_from([False] * 5 + [True])
authorities = st.sampled_from(["", "odometry"])


class TreeAndOracle(RuleBasedStateMachine):
    concurrency: ClassVar[Concurrency]

    @initialize(time_jump=st.sampled_from(["reject", "reject", "clear"]))
    def start(self, time_jump: Literal["reject", "clear"]) -> None:
        self.oracle = Oracle(CACHE_NS, MAX_DEPTH, time_jump)
        self.tree = TransformTree(
            CACHE_NS / 1e9,
            self.concurrency,
            time_jump=time_jump,
            max_depth=MAX_DEPTH,
            max_frames=64,
        )

    def both(self, method: str, *arguments: object) -> None:
        call = Call(method, arguments)
        right, given = ask(self.oracle, call), ask(self.tree, call)
        assert same(right, given), (right, given)

    @rule(rows=st.lists(rows, min_size=1, max_size=5), authority=authorities, static=rarely)
    def set_transforms(self, rows: list[Row], authority: str, static: bool) -> None:
        for row in rows:
            self.both("set_transform", row, authority, static)
        self.look_closely(rows[-1].parent, rows[-1].child)

    def look_closely(self, into: str, out_of: str) -> None:
        self.both("sample", into, out_of, PROBES)
        self.both("lookup_transform", into, out_of, None)
        self.both("lookup_latest_transform_xact", out_of, into)
        self.both("frame", out_of)

    @rule(rows=st.lists(rows, max_size=4).map(tuple), static=rarely)
    def set_transforms_xact(self, rows: tuple[Row, ...], static: bool) -> None:
        self.both("set_transforms_xact", rows, "", static)
        for row in rows:
            if row.child in self.oracle.frames():
                self.look_closely("map", row.child)

    @precondition(lambda self: self.oracle.links)
    @rule(name=asked, subtree=st.booleans())
    def remove_frame(self, name: str, subtree: bool) -> None:
        self.both("remove_frame", name, subtree)
        self.both("stats")

    @precondition(lambda self: self.oracle.links)
    @rule(keep_static=st.booleans())
    def clear(self, keep_static: bool) -> None:
        self.both("clear", keep_static)

    @precondition(lambda self: len(self.oracle.links) > 3)
    @rule()
    def reset(self) -> None:
        self.both("reset")
        self.both("frames")
        self.both("stats")

    @rule(into=asked, out_of=asked, stamp_ns=times)
    def look_up(self, into: str, out_of: str, stamp_ns: int | None) -> None:
        self.both("lookup_transform", into, out_of, stamp_ns)
        self.both("can_transform", into, out_of, stamp_ns)
        self.both("chain", into, out_of, stamp_ns)
        self.both("parent", into, stamp_ns)

    @rule(into=asked, into_ns=times, out_of=asked, out_of_ns=times, fixed=asked)
    def look_up_in_full(
        self, into: str, into_ns: int | None, out_of: str, out_of_ns: int | None, fixed: str
    ) -> None:
        self.both("lookup_transform_full", into, into_ns, out_of, out_of_ns, fixed)

    @rule(pairs=st.lists(st.tuples(asked, asked), max_size=3))
    def look_up_latest(self, pairs: list[tuple[str, str]]) -> None:
        self.both("lookup_latest_transforms_xact", pairs)
        for pair in pairs:
            self.both("lookup_latest_transform", *pair)
            self.both("lookup_latest_transform_xact", *pair)
            self.both("latest_common_time", *pair)

    @rule(into=asked, out_of=asked, stamps_ns=st.lists(stamps, max_size=10))
    def sample(self, into: str, out_of: str, stamps_ns: list[int]) -> None:
        self.both("sample", into, out_of, stamps_ns)

    @rule(name=asked)
    def introspect(self, name: str) -> None:
        self.both("frames")
        self.both("stats")
        self.both("frame", name)


SETTINGS = settings(
    max_examples=80,
    stateful_step_count=25,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)


@pytest.mark.timeout(180)
@pytest.mark.parametrize("concurrency", FRAME_LOCKS)
def test_every_program_of_calls(concurrency: Concurrency) -> None:
    machine = type("Machine", (TreeAndOracle,), {"concurrency": concurrency})
    run_state_machine_as_test(machine, settings=SETTINGS)
