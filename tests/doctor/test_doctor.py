"""The doctor finds each fault in a tree that has it, and nothing in a healthy one."""

from __future__ import annotations

import contextlib
import itertools
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from zenoh_tf import (
    AuthorityInfo,
    ClientInfo,
    InvalidArgumentException,
    StampedTransform,
    Transform,
    TransformTree,
)
from zenoh_tf_tools.doctor import CATALOGUE, LinkFacts, TreeFacts, diagnose

DOCS = Path(__file__).resolve().parents[2] / "docs"
S = 10**9
NOW_NS = 1_700_000_000 * S


class Patient:
    """A tree, and what was observed of it."""

    def __init__(self) -> None:
        self.tree = TransformTree()
        self.put("map", "odom", *range(-9, 1), authority="amcl")
        self.put("odom", "base", *(n / 10 for n in range(-99, 1)), authority="wheels")
        self.put("base", "camera", 0, authority="mounts", static=True)
        self.start: dict[str, LinkFacts] | None = None
        self.clients: list[ClientInfo] = []
        self.clocks: dict[str, tuple[float, float]] = {}
        self.refused: dict[str, str] = {}

    def put(
        self, parent: str, child: str, *stamps_s: float, authority: str = "", static: bool = False
    ) -> None:
        for stamp_s in stamps_s:
            at = StampedTransform(parent, child, NOW_NS + round(stamp_s * S), Transform((1, 0, 0)))
            self.tree.set_transform(at, authority=authority, static=static)

    def observe(self) -> None:
        """What comes from now on is seen to change."""
        self.start = {name: LinkFacts(self.tree.frame(name)) for name in self.tree.frames()}

    def facts(self) -> TreeFacts:
        links = [
            LinkFacts(
                self.tree.frame(name),
                self.start[name].frame if self.start and name in self.start else None,
            )
            for name in self.tree.frames()
        ]
        return TreeFacts(
            links, NOW_NS, 2.0 if self.start else 0.0, [*map(self._authority, self._names())],
            clients=self.clients,
        )  # fmt: skip

    def _names(self) -> list[AuthorityInfo]:
        return self.tree.authorities()

    def _authority(self, authority: AuthorityInfo) -> AuthorityInfo:
        least, greatest = self.clocks.get(authority.name, (-0.02, -0.01))
        reason = self.refused.get(authority.name)
        return replace(
            authority,
            clock_offset_min_s=least,
            clock_offset_max_s=greatest,
            refused=0 if reason is None else 3,
            last_refusal=reason,
        )


def two_publishers(patient: Patient) -> str:
    for n, authority in enumerate(["wheels", "old-driver", "wheels"]):
        patient.put("odom", "base", 0.01 * n, authority=authority)
    return "base: the link has changed hands twice, the last time to 'wheels'; others that have "


def flip_flop(patient: Patient) -> str:
    patient.put("map", "cup", -1)
    patient.observe()
    for n, parent in enumerate(["base", "map", "base", "map"]):
        patient.put(parent, "cup", 0.01 * n - 0.5)
    return "cup: its parent has changed 4 times in 2.0 s, such as from 'base' to 'map'"


def static_and_dynamic(patient: Patient) -> str:
    patient.put("base", "camera", 0, authority="state publisher")
    patient.put("base", "camera", 0, authority="state publisher", static=True)
    return "camera: the link has switched between static and dynamic twice; now it is static, by "


def stopped(patient: Patient) -> str:
    patient.put("base", "lidar", *(n / 20 for n in range(-99, -60)), authority="lidar driver")
    return "lidar: its newest sample is 3.0 s old; they came at 20.5 Hz from 'lidar driver'"


def refused(patient: Patient) -> str:
    patient.refused = {"wheels": "'base': the rotation is no unit quaternion"}
    return "wheels: 3 of its transforms were refused, the last because: 'base': the rotation is "


def clock_ahead(patient: Patient) -> str:
    patient.clocks = {"amcl": (0.9, 1.0)}
    return "amcl: its clock is ahead of the server's by 0.900 to 1.000 s"


def clock_behind(patient: Patient) -> str:
    patient.clocks = {"amcl": (-3.0, -2.5)}
    return "amcl: its clock is behind the server's by 2.500 to 3.000 s"


def clock_of_a_client(patient: Patient) -> str:
    patient.clients = [
        ClientInfo("c0ffee", 0.4, 0.5, 1.0, "tcp/10.0.0.7:1"),
        ClientInfo("600d", -0.001, 0.002, 1.0),
    ]
    return "c0ffee: the clock of this client (tcp/10.0.0.7:1) is ahead of the server's by 0.400 to"


def future_stamps(patient: Patient) -> str:
    patient.put("map", "odom", 1, authority="amcl")
    return "odom: its newest stamp is 1.0 s ahead of the clock; it is by 'amcl'"


def repeated_stamps(patient: Patient) -> str:
    patient.put("odom", "base", 0, 0, 0, authority="wheels")
    return "base: 3 samples had a stamp that the link had already; it is by 'wheels'"


def too_old(patient: Patient) -> str:
    patient.put("odom", "base", -30, authority="wheels")
    return "base: 1 transforms were older than the cache time and dropped"


def time_jumps(patient: Patient) -> str:
    patient.tree = TransformTree(time_jump="clear")
    patient.put("map", "odom", *range(-9, 1))
    patient.put("map", "odom", *(n - 100 for n in range(5)))
    return "odom: its history was cleared once as time was set back"


def unconnected(patient: Patient) -> str:
    patient.put("world", "tool", 0, static=True)
    return "world: this root's tree of 2 frames is not connected to the largest one, whose root is"


def alike_names(patient: Patient) -> str:
    patient.put("map", "Base/", 0, static=True)
    return "Base/: these frames differ by slashes or case only: 'Base/', 'base'"


def deep(patient: Patient) -> str:
    for parent, child in itertools.pairwise(["camera", *(f"step {n}" for n in range(99))]):
        patient.put(parent, child, 0, static=True)
    return "step 98: 102 links lie between it and its root"


MAKERS: dict[str, list[Callable[[Patient], str]]] = {
    "TF101": [two_publishers],
    "TF102": [flip_flop],
    "TF103": [static_and_dynamic],
    "TF104": [stopped],
    "TF106": [refused],
    "TF201": [clock_ahead, clock_behind, clock_of_a_client],
    "TF202": [future_stamps],
    "TF203": [repeated_stamps],
    "TF204": [too_old],
    "TF205": [time_jumps],
    "TF301": [unconnected],
    "TF302": [alike_names],
    "TF303": [deep],
}
#: What a fault brings with it.
ALSO = {"time_jumps": {"TF104"}}


def test_every_fault_that_the_records_show_is_made() -> None:
    """`test_faults.py` has those that only samples show."""
    assert {*MAKERS} < {fault.id for fault in CATALOGUE}


@pytest.mark.parametrize(
    ("fault", "make"), [(fault, make) for fault, makers in MAKERS.items() for make in makers]
)
def test_each_fault_is_found_in_a_tree_that_has_it(
    fault: str, make: Callable[[Patient], str]
) -> None:
    patient = Patient()
    said = make(patient)
    found = diagnose(patient.facts())
    assert {finding.fault.id for finding in found} - ALSO.get(make.__name__, set()) == {fault}
    texts = [f"{f.subject}: {f.evidence}" for f in found if f.fault.id == fault]
    assert len(texts) == 1
    assert texts[0].startswith(said), texts
    assert diagnose(patient.facts(), ignore=[fault, *ALSO.get(make.__name__, ())]) == []


@pytest.mark.parametrize("observed", [False, True])
def test_nothing_is_found_in_a_healthy_tree(observed: bool) -> None:
    patient = Patient()
    if observed:
        patient.observe()
    patient.clients = [ClientInfo("c0ffee", -0.2, 0.3, 1.0)]
    patient.put("base", "gripper", 0, authority="arm")  # one sample so far
    patient.put("gripper", "cup", -0.2, authority="grasping")
    patient.put("map", "cup", -0.1, authority="grasping")  # set down
    assert diagnose(patient.facts()) == []


def test_nothing_is_found_in_an_empty_tree() -> None:
    assert diagnose(TreeFacts([], NOW_NS)) == []


def test_stamps_of_another_clock_are_neither_old_nor_ahead() -> None:
    patient = Patient()
    facts = replace(patient.facts(), now_ns=NOW_NS + 10**7 * S)
    assert diagnose(facts) == []
    patient.put("base", "lidar", *(n / 20 for n in range(-99, -60)))
    facts = replace(patient.facts(), now_ns=NOW_NS + 10**7 * S)
    assert [finding.evidence[:45] for finding in diagnose(facts)] == [
        "its newest sample is 3.0 s behind the newest "
    ]


def of_records(tree: TransformTree, after_s: float = 0.0) -> list[str]:
    """What the records alone show at the real time, or some time later."""
    links = [LinkFacts(tree.frame(name)) for name in tree.frames()]
    found = diagnose(TreeFacts(links, time.time_ns() + round(after_s * S)))
    return [f"{finding.fault.id} {finding.evidence}" for finding in found]


def test_a_static_value_that_was_replaced_is_known_for_a_while() -> None:
    tree = TransformTree()
    for x_m, authority in ((0.3, "urdf"), (0.3, "calibration"), (0.312, "calibration")):
        mount = StampedTransform("base", "camera", 0, Transform((x_m, 0, 0)))
        tree.set_transform(mount, authority=authority, static=True)
        if x_m == 0.3:
            assert of_records(tree) == []
    (found,) = of_records(tree, 5)
    assert found.startswith("TF402 its static value was replaced once, 5.0 s ago, the last time by")
    assert found.endswith("one that is 12.0 mm off; now it is by 'calibration'")
    assert of_records(tree, 3600) == []


def test_a_stamp_ahead_that_cleared_a_history_is_known_for_a_while() -> None:
    tree = TransformTree()
    now_ns = time.time_ns()
    for stamp_s in (-2, -1, 60, 0.0, 0.1):
        row = StampedTransform("map", "base", now_ns + round(stamp_s * S), Transform())
        with contextlib.suppress(InvalidArgumentException):
            tree.set_transform(row)
    assert tree.frame("base").time_jumps == 1
    (found,) = of_records(tree, 0.1)
    assert found.startswith("TF202 a stamp was 60.0 s ahead of the clock ")


def test_an_unknown_fault_cannot_be_ignored() -> None:
    with pytest.raises(ValueError, match="no fault 'TF999'"):
        diagnose(TreeFacts([], NOW_NS), ignore=["TF999"])


def test_the_snippet_of_the_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    text = (DOCS / "reference/doctor.md").read_text()
    snippet = re.findall(r"```python\n(.*?)```", text, re.S)[0]
    patient = Patient()
    stopped(patient)
    exec(f"import time\n{snippet}", {"tree": patient.tree})
    assert "TF104 lidar " in capsys.readouterr().out
