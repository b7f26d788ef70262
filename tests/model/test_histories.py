"""Random histories: the tree against the oracle, answer by answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Literal

import pytest

from tests.support.runs import CONTROLS
from zenoh_tf import TransformTree

from .calls import Fault, ask, same
from .histories import CACHE_NS, SEEDS, History, history
from .oracle import Oracle

Concurrency = Literal["optimistic", "2pl", "giant"]

#: Events that must have occurred, so that agreement means something.
EVENTS = {
    "stored",
    "static",
    "dropped",
    "rewritten",
    "out of order",
    "pruned",
    "switched",
    "reparented",
    "interpolated",
    "older parent stands",
    "past loop",
    "refused: too old in a transaction",
    "refused: cycle",
    "refused: too deep",
    "refused: empty name",
    "refused: two slashes",
    "refused: too far",
    "refused: own parent",
    "refused: not finite",
    "refused: not a rotation",
    "set_transforms_xact: done",
    "clear: done",
    "reset: done",
    "lookup_transform: LookupException",
    "lookup_transform: ConnectivityException",
    "lookup_transform: InvalidArgumentException",
    "lookup_transform: NoDataForExtrapolationException",
    "lookup_transform: BackwardExtrapolationException",
    "lookup_transform: ForwardExtrapolationException",
    "lookup_transform: done",
    "lookup_transform_full: done",
    "lookup_latest_transform: done",
    "lookup_latest_transform_xact: done",
    "lookup_latest_transforms_xact: done",
    "latest_common_time: done",
    "sample: done",
    "can_transform: done",
    "chain: done",
    "parent: done",
    "frame: done",
    "frames: done",
    "stats: done",
    "removed",
    "come back",
    "refused: parent of others",
    "time jump",
}


def compare(script: History, concurrency: Concurrency, events: Counter[str]) -> str | None:
    """Return the first difference, or None."""
    oracle = Oracle(CACHE_NS, script.max_depth, script.time_jump)
    tree = TransformTree(
        CACHE_NS / 1e9,
        concurrency,
        time_jump=script.time_jump,
        max_depth=script.max_depth,
        max_frames=64,
    )
    for number, (write, questions) in enumerate(script.steps):
        for call in [write, *questions]:
            right, given = ask(oracle, call), ask(tree, call)
            events[f"{call.method}: {right.kind if isinstance(right, Fault) else 'done'}"] += 1
            if not same(right, given):
                return f"after write {number}, {call}\n  oracle {right}\n  tree   {given}"
    events.update(oracle.events)
    return None


def shortened(script: History, concurrency: Concurrency) -> History:
    """Return a smaller history with a difference: the prefix, minus each write not needed."""
    steps = script.steps
    while compare(script._replace(steps=steps[:-1]), concurrency, Counter()):
        steps = steps[:-1]
    for i in range(len(steps) - 2, -1, -1):
        fewer = [*steps[:i], *steps[i + 1 :]]
        if compare(script._replace(steps=fewer), concurrency, Counter()):
            steps = fewer
    return script._replace(steps=steps)


def check(histories: Iterable[History], concurrency: Concurrency) -> Counter[str]:
    events: Counter[str] = Counter()
    for script in histories:
        if compare(script, concurrency, events):
            short = shortened(script, concurrency)
            pytest.fail(f"{short}\n{compare(short, concurrency, Counter())}", pytrace=False)
    return events


@pytest.mark.timeout(60 + len(SEEDS) * 0.2)
@pytest.mark.parametrize("concurrency", CONTROLS)
def test_every_answer_is_the_oracles(concurrency: Concurrency) -> None:
    events = check(map(history, SEEDS), concurrency)
    for event in sorted(events):
        print(f"{events[event]:9} {event}")
    if len(SEEDS) > 1:
        assert sorted(EVENTS - events.keys()) == []
