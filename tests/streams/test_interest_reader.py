"""What an interested mirror is sent: the frames on the paths, whole and at one instant."""

from __future__ import annotations

import random
import threading
import time
from itertools import pairwise

import numpy as np
import pytest

from tests.support.logged_trees import (
    FEW_FRAMES,
    FRAMES,
    MANY,
    VISITORS,
    Mirror,
    State,
    Writer,
    follow,
    logged,
    state,
)
from tests.support.runs import CONTROLS
from tests.support.threads import beside
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import InterestReader
from zenoh_tf.errors import TransformException

#: `make test` has the first ones.
SEEDS = [*range(3), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 8))]
#: The bits of a mirror's version that are the server's.
SERVER_VERSION = (1 << 48) - 1


def mirror_state(mirror: Mirror) -> State:
    found = state(mirror.tree)
    return {name: (version & SERVER_VERSION, *rest) for name, (version, *rest) in found.items()}  # type: ignore[misc]


def path(tree: State, name: str) -> list[str]:
    found = [name]
    while tree[found[-1]][3]:
        parent = tree[found[-1]][3][-1][1]
        assert parent is not None
        found.append(parent)
    return found


def parents(tree: State, name: str) -> set[str]:
    return {parent for _, parent, _ in tree[name][3] if parent in tree}


def paths(tree: State, pairs: list[tuple[str, str]]) -> set[str]:
    """The reference: which frames a mirror of the pairs must have."""
    found: set[str] = set()
    for a, b in pairs:
        if a not in tree or b not in tree:
            found |= {name for name in (a, b) if name in tree}
            continue
        one, other = path(tree, a), path(tree, b)
        if any(len({parent for _, parent, _ in tree[name][3]}) > 1 for name in {*one, *other}):
            found |= all_ancestors(tree, a) | all_ancestors(tree, b)
            continue
        while len(one) > 1 and len(other) > 1 and one[-2] == other[-2]:
            del one[-1], other[-1]
        while one[-1] == other[-1] and (
            (len(one) > 1 and one[-2] in other) or (len(other) > 1 and other[-2] in one)
        ):
            del one[-1], other[-1]
        found |= {*one, *other}
    return found


def all_ancestors(tree: State, start: str) -> set[str]:
    found, open_ = {start}, [start]
    while open_:
        more = parents(tree, open_.pop()) - found
        found |= more
        open_ += more
    return found


@pytest.mark.parametrize("max_frames", [64, FEW_FRAMES])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_frames_on_the_paths_are_the_servers(seed: int, max_frames: int) -> None:
    tree, log = logged(("optimistic", "2pl", "giant")[seed % 3], max_frames)
    writer = Writer(tree, seed, visits=max_frames == FEW_FRAMES)
    chance = random.Random(seed)
    names = FRAMES + VISITORS if max_frames == FEW_FRAMES else FRAMES
    pairs = [(chance.choice(FRAMES), chance.choice(names)) for _ in range(chance.randrange(1, 4))]
    reader = InterestReader(tree, pairs, False)
    mirrors = [Mirror(max_frames=4096)]
    follow(mirrors[0], reader, begin=True)
    for step in range(600):
        for _ in range(chance.randrange(3)):
            writer.write()
        before = state(tree)
        if step % 150 == 149:  # another one begins: what it gets is sent to the others, too
            seq, reparented, changes, everything = reader.read(True, MANY)
            assert everything is not None
            for mirror in mirrors:
                if changes is not None:
                    mirror.replay.apply(seq, changes)
            mirrors.append(Mirror(max_frames=4096))
            if reparented:
                mirrors[-1].replay.set_ever_reparented()
            mirrors[-1].replay.apply(seq, everything)
        else:
            seq, _, changes, _ = reader.read(False, MANY)
            for mirror in mirrors:
                if changes is not None:
                    mirror.replay.apply(seq, changes)
        assert seq == log.last
        assert not reader.has_changed()
        wanted = paths(before, pairs)
        for mirror in mirrors:
            assert mirror_state(mirror) == {name: before[name] for name in wanted}
            same_answers(mirror.tree, tree, pairs, writer.now)
        assert reader.frames == len(wanted)


def same_answers(
    mirror: TransformTree, tree: TransformTree, pairs: list[tuple[str, str]], now: int
) -> None:
    stamps = np.arange(now - 120, now + 10, 7)
    for a, b in pairs:
        here, there = mirror.sample(a, b, stamps), tree.sample(a, b, stamps)
        assert np.array_equal(here.ok, there.ok), (a, b)
        assert np.allclose(here.translations[here.ok], there.translations[here.ok], atol=1e-9)
        for lookup in ("lookup_transform", "lookup_latest_transform_xact"):
            assert answer(mirror, lookup, a, b) == answer(tree, lookup, a, b)


def answer(tree: TransformTree, lookup: str, a: str, b: str) -> object:
    try:
        found = getattr(tree, lookup)(a, b)
    except TransformException:
        return None
    return found.stamp_ns, np.round(found.transform.translation, 9).tolist()


@pytest.mark.parametrize("seed", range(6))
def test_failures_are_of_the_servers_class(seed: int) -> None:
    """And what is found is the same."""
    tree, _ = logged(max_frames=FEW_FRAMES)
    writer = Writer(tree, seed, visits=True)
    chance = random.Random(seed)
    pairs = [(chance.choice(FRAMES), chance.choice(FRAMES + VISITORS)) for _ in range(3)]
    reader = InterestReader(tree, pairs, False)
    mirror = Mirror(max_frames=4096)
    follow(mirror, reader, begin=True)
    failures = 0
    for _ in range(300):
        writer.write()
        follow(mirror, reader)
        same_answers(mirror.tree, tree, pairs, writer.now)
        for pair in pairs:
            for stamp_ns in (None, writer.now, writer.now - chance.randrange(110)):
                here = failure(mirror.tree, *pair, stamp_ns)
                there = failure(tree, *pair, stamp_ns)
                assert type(here) is type(there)  # both of NoneType: same_answers() compares them
                failures += here is not None
    assert failures > 100


def test_a_failure_names_no_link_above_the_common_ancestor() -> None:
    """So a mirror of the pair, which has no such link, fails as the server does."""
    tree, _ = logged()
    for parent, child, stamps in (
        ("map", "odom", (49, 50)),
        ("odom", "top", (1, 50)),
        ("top", "a", (1, 50)),
        ("top", "b", (50,)),
    ):
        for stamp_ns in stamps:
            tree.set_transform(StampedTransform(parent, child, stamp_ns, Transform()))
    reader = InterestReader(tree, [("a", "b")], False)
    mirror = Mirror()
    follow(mirror, reader, begin=True)
    assert sorted(mirror.tree.frames()) == ["a", "b", "top"]
    there, here = failure(tree, "a", "b", 20), failure(mirror.tree, "a", "b", 20)
    for found in (there, here):
        assert (type(found).__name__, found.frame) == ("NoDataForExtrapolationException", "b")  # type: ignore[union-attr]


def test_past_links_above_the_common_ancestor() -> None:
    """They may lead back to the pair or into a loop: the mirror has them, and so answers and fails
    as the server does."""
    tree, _ = logged()

    def link(parent: str, child: str, x: float, *stamps: int) -> None:
        for stamp_ns in stamps:
            tree.set_transform(StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0))))

    link("map", "mid", 5, 50)
    link("mid", "top", 0, 1, 50)
    for child, x, stamps in (("b", 100, (1, 50)), ("c", 1000, (50,)), ("d", 10, (1, 50))):
        link("top", child, x, *stamps)
    pairs = [("b", "d"), ("d", "b"), ("c", "b"), ("b", "c")]
    reader = InterestReader(tree, pairs, False)
    mirror = Mirror()
    follow(mirror, reader, begin=True)
    assert sorted(mirror.tree.frames()) == ["b", "c", "d", "top"]

    def check(expected: str) -> None:
        assert reader.has_changed()  # as the server asks before it reads
        follow(mirror, reader)
        assert not reader.has_changed()
        assert sorted(mirror.tree.frames()) == ["b", "c", "d", "map", "mid", "top"]
        same_answers(mirror.tree, tree, pairs, 60)  # from before all samples to after them
        for pair in pairs:
            there, here = failure(tree, *pair, 20), failure(mirror.tree, *pair, 20)
            assert (type(here), str(here)) == (type(there), str(there))
        assert type(failure(tree, "c", "b", 20)).__name__ == expected

    link("d", "mid", 1, 1, 30)  # b, top, mid, d at that time, but also b, top and d, top
    assert tree.lookup_transform("d", "b", 20).transform.translation[0] == 101
    check("LookupException")  # c has no sample then, and b runs in that loop
    link("c", "mid", 1, 1, 30)  # b leads to it, too
    assert tree.lookup_transform("c", "b", 20).transform.translation[0] == 101
    check("NoneType")


@pytest.mark.parametrize("removed", [True, False])
def test_a_frame_without_samples_has_no_authority(removed: bool) -> None:
    """It has lost them by a clear, or was removed and came back as a parent between two reads."""
    tree, log = logged()
    position = log.start()
    tree.set_transform(StampedTransform("map", "a", 1, Transform()), "sensor")
    reader = InterestReader(tree, [("map", "a")], False)
    early, late, full = Mirror(), Mirror(), Mirror()
    follow(early, reader, begin=True)
    assert early.tree.frame("a").authority == "sensor"
    if removed:
        tree.remove_frame("a")
        tree.set_transform(StampedTransform("a", "b", 1, Transform()), "other")
    else:
        tree.clear(keep_static=False)
    follow(early, reader)
    follow(late, InterestReader(tree, [("map", "a")], False), begin=True)
    first, last, lost, changes = log.take(MANY)
    assert (first, lost) == (position + 1, False)
    assert changes is not None
    full.replay.apply(last, changes)
    for each in (tree, early.tree, late.tree, full.tree):
        assert each.frame("a").authority == ""


def test_a_past_parent_that_comes_back() -> None:
    """Its name comes back, and so do links at past times, while no frame of the mirror changes."""
    tree, _ = logged()

    def link(parent: str, child: str, *stamps: int) -> None:
        for stamp_ns in stamps:
            tree.set_transform(StampedTransform(parent, child, stamp_ns, Transform((1, 0, 0))))

    link("holder", "a", 1, 20)
    link("map", "b", 1, 50)
    link("map", "a", 50)
    tree.remove_frame("holder")
    reader = InterestReader(tree, [("a", "b")], False)
    mirror = Mirror()
    follow(mirror, reader, begin=True)
    assert sorted(mirror.tree.frames()) == ["a", "b", "map"]
    assert failure(mirror.tree, "b", "a", 10) is not None
    link("map", "holder", 1, 50)
    assert reader.has_changed()
    follow(mirror, reader)
    assert sorted(mirror.tree.frames()) == ["a", "b", "holder", "map"]
    same_answers(mirror.tree, tree, [("a", "b")], 60)
    assert mirror.tree.lookup_transform("b", "a", 10).transform.translation[0] == 1


def failure(
    tree: TransformTree, target: str, source: str, stamp_ns: int | None
) -> TransformException | None:
    try:
        tree.lookup_transform(target, source, stamp_ns)
    except TransformException as error:
        return error
    return None


@pytest.mark.parametrize("concurrency", CONTROLS)
def test_reads_beside_writers_are_of_one_instant(concurrency: str) -> None:
    """Each commit moves a chain as a whole, by turns under two parents; frames come and go."""
    tree, _ = logged(concurrency)
    names = [f"f{i}" for i in range(6)]

    def links(number: int, top: str) -> list[StampedTransform]:
        chain = [top, *names]
        return [
            StampedTransform(parent, child, number, Transform((number, 0, 0)))
            for parent, child in pairwise(chain)
        ]

    tree.set_transforms_xact([*links(1, "a"), StampedTransform("root", "a", 1, Transform())])
    tree.set_transform(StampedTransform("root", "b", 1, Transform()), static=True)

    def write(ending: threading.Event) -> None:
        number = 1
        while not ending.is_set():
            number += 1
            tree.set_transforms_xact(links(number, "ab"[number // 50 % 2]))
            if number % 70 == 0:
                tree.clear(keep_static=False)
                again = [*links(number, "a"), StampedTransform("root", "a", 1, Transform())]
                tree.set_transforms_xact(again)
                tree.set_transform(StampedTransform("root", "b", 1, Transform()), static=True)

    reader = InterestReader(tree, [("root", "f5"), ("a", "nobody")], False)
    mirror = Mirror(max_frames=4096)
    follow(mirror, reader, begin=True)
    with beside(write):
        last = 0
        seen: set[int] = set()
        end_s = time.monotonic() + 60
        while len(seen) < 300:
            assert time.monotonic() < end_s
            position = follow(mirror, reader)
            assert position >= last
            last = position
            state_now = mirror_state(mirror)
            linked = [name for name in names if name in state_now and state_now[name][3]]
            stamps = {state_now[name][3][-1][0] for name in linked}
            assert len(stamps) <= 1, stamps
            seen |= stamps
    follow(mirror, reader)
    assert mirror_state(mirror) == {name: state(tree)[name] for name in state(mirror.tree)}
