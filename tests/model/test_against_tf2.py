"""The same random histories, run by the real tf2 where it is installed.

Its answers must equal the tree's, except for the differences that ``differences.py`` lists.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import pytest

from zenoh_tf import InvalidArgumentException, TransformTree

from .calls import Call, Fault, ask, same
from .differences import DECISIONS, AsTf2, reasons
from .histories import CACHE_NS, DEEP, SEEDS, History, history
from .oracle import Answer, Oracle, Row
from .stored import MAX_TRANSLATION

pytestmark = pytest.mark.slow

PYTHON_WITH_TF2 = "/usr/bin/python3"
START_NS = 100_000_000_000  # tf2 has no times below 0, and its 0 means the latest
QUESTIONS = {
    "lookup_transform",
    "lookup_transform_full",
    "can_transform",
    "latest_common_time",
    "frames",
}


class Peer:
    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [PYTHON_WITH_TF2, str(Path(__file__).with_name("tf2_peer.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # it logs a warning for every rejected write
            text=True,
        )

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def ask(self, calls: list[Call]) -> list[object]:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({"cache_ns": CACHE_NS, "calls": calls}) + "\n")
        self.process.stdin.flush()
        return [_parsed(reply) for reply in json.loads(self.line())]


def no_tf2(reason: str) -> NoReturn:
    """Skip, but where tf2 is expected, fail."""
    if os.environ.get("REQUIRE_TF2"):
        pytest.fail(f"{reason}, and REQUIRE_TF2 is set")
    pytest.skip(reason)


@pytest.fixture(scope="module")
def tf2() -> Iterator[Peer]:
    try:
        peer = Peer()
    except FileNotFoundError:
        no_tf2(f"no {PYTHON_WITH_TF2}, whose tf2 would be asked")
    with peer.process:  # closing the input ends the peer
        if not peer.line():
            no_tf2(f"{PYTHON_WITH_TF2} has no tf2_py (Debian: python3-tf2)")
        yield peer


def _parsed(reply: Any) -> object:
    if isinstance(reply, dict) and "pose" in reply:
        return Answer(reply["stamp_ns"], None, tuple(reply["pose"]))
    if isinstance(reply, dict):
        return Fault(reply["error"], reply["facts"])
    return reply


class Asked(NamedTuple):
    call: Call
    by_rule: object  # what tf2 must answer
    ours: object
    reasons: set[str]  # decisions that allow a difference


class Prepared:
    """A history run by the tree and both oracles, and the calls that tf2 will run."""

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self.tree = TransformTree(CACHE_NS / 1e9, max_depth=DEEP, max_frames=64)
        self.ours, self.theirs = Oracle(CACHE_NS, DEEP), AsTf2(CACHE_NS, DEEP)
        self.calls: list[Call] = []  # to tf2
        self.asked: dict[int, Asked] = {}  # by place in calls

    def write(self, call: Call) -> None:
        if call.method in ("remove_frame", "reset"):
            return  # tf2 has neither
        if call.method == "clear":  # tf2 has no other one
            for tree in (self.tree, self.ours, self.theirs):
                tree.clear()
            self.calls.append(Call("clear", ()))
            return
        rows, authority, static = call.arguments
        single = call.method == "set_transform"
        rows = [rows] if single else sorted(rows, key=lambda row: row.stamp_ns)
        try:
            good = [self.ours.checked(row) for row in rows]
        except InvalidArgumentException:
            self._refused(rows, authority, static, single)
            return
        links, _ = self.ours.with_rows(self.ours.links, good, static)
        if self.ours.has_cycle(links) or self.theirs.closes_cycle(good, static):
            self.counts["F07"] += 1
            return
        outcome = ask(self.tree, call)
        assert same(ask(self.ours, call), outcome), call
        if isinstance(outcome, Fault):
            self.counts["A10"] += 1
            return
        self.theirs.commit(rows, static, drop_old=True)
        for row, stored in zip(rows, good, strict=True):
            given = row._replace(pose=stored.pose)
            self.counts["A08"] += not same(Answer(0, None, row.pose), Answer(0, None, given.pose))
            self.calls.append(Call("set_transform", (given, authority, static)))

    def _refused(self, rows: list[Row], authority: str, static: bool, single: bool) -> None:
        """Both reject invalid rows; tf2 one by one, and it accepts more."""
        if not single:
            self.counts["A10"] += 1
        elif any(abs(value) > MAX_TRANSLATION for value in rows[0].pose):
            self.counts["A08b"] += 1
        elif rows[0].child.startswith("//"):
            self.counts["A09"] += 1
        else:
            self.calls.append(Call("set_transform", (rows[0], authority, static)))

    def question(self, call: Call) -> None:
        if call.method == "sample":
            target, source, stamps_ns = call.arguments
            for stamp_ns in stamps_ns:
                self.question(Call("lookup_transform", (target, source, stamp_ns)))
        if call.method not in QUESTIONS:
            return
        self.theirs.fired.clear()
        by_rule, ours = ask(self.theirs, call), ask(self.tree, call)
        may_differ = set() if same(by_rule, ours) else reasons(self.ours, self.theirs, call)
        self.asked[len(self.calls)] = Asked(call, by_rule, ours, may_differ)
        self.calls.append(call)


def agree(theirs: object, given: object) -> bool:
    """Compare. tf2 uses 0 for "any time", orders no frames, and its errors have fewer fields."""
    if isinstance(theirs, Fault) and isinstance(given, Fault):
        return theirs.kind == given.kind and theirs.facts.items() <= given.facts.items()
    if isinstance(theirs, list) and isinstance(given, list):
        return sorted(theirs) == sorted(given)
    return same(theirs, 0 if given is None else given)


def replay(script: History, peer: Peer, counts: Counter[str]) -> None:
    history_ = Prepared(counts)
    for write, questions in script.steps:
        history_.write(write)
        for question in questions:
            history_.question(question)
    replies = peer.ask(history_.calls)
    for place, (call, by_rule, ours, why) in history_.asked.items():
        theirs = replies[place]
        said = f"seed {script.seed}, {call}\n  tf2  {theirs}\n  rule {by_rule}\n  tree {ours}"
        assert agree(theirs, by_rule), said + _told_so_far(history_.calls[:place])
        counts["answers"] += 1
        if not agree(theirs, ours):
            assert why, f"no decision says why\n{said}"
            counts["differ"] += 1
            counts.update(why)


def _told_so_far(calls: list[Call]) -> str:
    return "\n".join(["", *(str(c) for c in calls if c.method not in QUESTIONS)])


@pytest.mark.timeout(60 + len(SEEDS) * 0.3)
def test_tf2_differs_only_where_a_decision_says_so(tf2: Peer) -> None:
    counts: Counter[str] = Counter()
    for seed in SEEDS:
        replay(history(seed, start_ns=START_NS), tf2, counts)
    print(f"\n{counts['answers']} answers, {counts['differ']} of them differ. Applied:")
    for row, decision in DECISIONS.items():
        print(f"{counts[row]:8} {row:4} {decision}")
    if len(SEEDS) > 1:
        assert sorted(DECISIONS.keys() - counts.keys()) == []
        assert counts["differ"] < counts["answers"] / 2


def test_what_is_kept_from_tf2_is_what_it_accepts(tf2: Peer) -> None:
    """The writes that the histories withhold from tf2, or change."""

    def row(parent: str, child: str, x: float = 0.0, w: float = 1.0) -> Call:
        stored = Row(parent, child, START_NS, (x, 0.0, 0.0, 0.0, 0.0, 0.0, w))
        return Call("set_transform", (stored, "", False))

    def after(*writes: Call, frames: tuple[str, str] = ("a", "b")) -> object:
        return tf2.ask([*writes, Call("lookup_transform", (*frames, START_NS))])[-1]

    raw, infinite = after(row("a", "b", w=1.004)), after(row("a", "b", x=math.inf))
    assert isinstance(raw, Answer) and raw.pose[6] == 1.004  # A08
    assert isinstance(infinite, Answer) and not math.isfinite(infinite.pose[0])  # A08b
    cycle = after(row("a", "b"), row("b", "a"), row("c", "d"), frames=("c", "b"))
    assert cycle == Fault("LookupException", {})  # F07
    assert isinstance(after(row("a", "b"), row("b", "a")), Answer)
