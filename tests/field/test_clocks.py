"""Clocks that jump: samples of another clock must not end a link.

Public reports, replayed by puts, through the ROS 2 bridge and in an embedded tree; and random
histories against a plain model of the rules in docs/explanation/clocks.md.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import pytest

from tests.conftest import LendServer
from tests.support import command_line
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import TransformRows
from zenoh_tf.admission import FROM_FUTURE, REASONS, STORED, TOO_OLD

S = 1_000_000_000
DAY_S = 86_400
#: The cache time of all trees here, seconds.
T_S = 10.0


def rows(*links: tuple[str, str, float]) -> TransformRows:
    return TransformRows.of_tuples(
        (parent, child, round(stamp_s * S), (stamp_s % 97, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
        for parent, child, stamp_s in links
    )


class Link:
    """One link of an embedded tree, fed by puts as a server does."""

    def __init__(self, time_jump: Literal["reject", "clear"] = "reject") -> None:
        self.tree = TransformTree(cache_time_s=T_S, time_jump=time_jump)

    def put(self, *stamps_s: float, authority: str = "wheels") -> list[str]:
        """Send a message with a sample for each stamp. Returns what became of each."""
        message = rows(*(("base", "wheel", stamp_s) for stamp_s in stamps_s))
        latest_ns = time.time_ns() + 3600 * S  # --max-future-s
        (outcome,) = self.tree._commit_puts([message], [authority], [latest_ns])
        assert not isinstance(outcome, Exception)
        stored = outcome or bytes([STORED]) * len(message)
        names = {TOO_OLD: "late", STORED: "stored", FROM_FUTURE: "from_future"} | {
            code: reason for code, reason in REASONS.items() if code > FROM_FUTURE
        }
        return [names[code] for code in stored]

    def send(self, *stamps_s: float) -> list[str]:
        """Send a message for each stamp."""
        return [self.put(stamp_s)[0] for stamp_s in stamps_s]

    @property
    def newest_s(self) -> float:
        return (self.tree.frame("wheel").newest_stamp_ns or 0) / S


def every(period_s: float, begin_s: float, end_s: float) -> list[float]:
    """Stamps at a period, from one time to another one, which is included."""
    return [begin_s + n * period_s for n in range(round((end_s - begin_s) / period_s) + 1)]


#: The wall clock of the report, and others.
STRAYS = [
    pytest.param(1_770_000_000.0, 0.02, 5, id="decades"),
    pytest.param(1_650_000_000.0, 0.5, 8, id="slow"),
    pytest.param(200.0, 0.02, 9, id="more than the history"),
    pytest.param(90_000.0, 0.0, 40, id="one stamp again and again"),
    pytest.param(5_000.0, 3.0, 2, id="two"),
]


@pytest.mark.parametrize(("at_s", "period_s", "count"), STRAYS)
@pytest.mark.parametrize("time_jump", ["reject", "clear"])
def test_strays_cost_no_other_sample(
    time_jump: Literal["reject", "clear"], at_s: float, period_s: float, count: int
) -> None:
    """ros/robot_state_publisher#202."""
    link = Link(time_jump)
    assert set(link.send(*every(0.02, 100, 106))) == {"stored"}
    assert set(link.send(*(at_s + n * period_s for n in range(count)))) == {"stray"}
    assert link.newest_s == 106
    assert link.tree.frame("wheel").samples == 301
    assert set(link.send(*every(0.02, 106.02, 112))) == {"stored"}
    assert link.tree.stats()["time_jumps"] == 0
    assert link.tree.lookup_transform("base", "wheel", round(105.5 * S))


@pytest.mark.parametrize("time_jump", ["reject", "clear"])
def test_a_long_spell_of_another_clock_ends_with_it(time_jump: Literal["reject", "clear"]) -> None:
    """The same report with a pause of seconds: the history of the old clock is lost, but the link
    is not."""
    link = Link(time_jump)
    link.send(*every(0.02, 100, 106))
    spell = link.send(*every(0.02, 1_770_000_000, 1_770_000_004))
    assert spell == ["stray"] * 9 + ["stored"] * (len(spell) - 9)
    back = link.send(*every(0.02, 106.02, 112))
    assert back == ["late"] + ["stored"] * (len(back) - 1)
    assert link.newest_s == 112
    assert link.tree.frame("wheel").time_jumps == 2


@pytest.mark.parametrize("back_s", [10.6, 60, 3_600, 80_000])
def test_a_set_back_of_one_clock_needs_two(back_s: float) -> None:
    """A bag that is played in a loop, or a simulation that was reset."""
    link = Link("clear")
    link.send(*every(0.02, 90_000, 90_006))
    assert link.send(90_006 - back_s, 90_006.02 - back_s) == ["late", "stored"]
    refusing = Link("reject")
    refusing.send(*every(0.02, 90_000, 90_006))
    assert set(refusing.send(*every(0.02, 90_006 - back_s, 90_006.5 - back_s))) == {"late"}


@pytest.mark.parametrize("back_s", [0.5, 5, 9.9])
def test_a_set_back_inside_the_history_is_a_late_sample(back_s: float) -> None:
    """A bag that is shorter than the cache, in a loop: docs/explanation/clocks.md says so."""
    link = Link("clear")
    link.send(*every(0.02, 100, 110))
    assert set(link.send(*every(0.02, 110 - back_s, 110))) == {"stored"}
    assert link.tree.stats()["time_jumps"] == 0
    assert link.newest_s == 110


@pytest.mark.parametrize(("new_s", "old_s"), [(100.0, 1_770_000_000.0), (3.0, 900_000.0)])
def test_a_few_samples_of_an_earlier_clock_clear_nothing(new_s: float, old_s: float) -> None:
    link = Link("clear")
    link.send(*every(0.1, old_s, old_s + 5))
    assert set(link.send(*every(0.02, new_s, new_s + 0.08))) == {"late"}
    assert set(link.send(*every(0.1, old_s + 5.1, old_s + 8))) == {"stored"}
    assert link.tree.frame("wheel").samples == 81
    found = link.send(*every(0.1, new_s, new_s + 5))  # it continues
    assert found == ["late"] * 9 + ["stored"] * (len(found) - 9)


def test_a_pause_is_no_jump() -> None:
    link = Link()
    now_s = time.time()
    assert set(link.send(now_s - 300, now_s - 299, now_s - 60, now_s - 0.1)) == {"stored"}
    # A minute ahead of the clock and of the other samples.
    assert link.send(now_s + 60, now_s + 60.02) == ["stray", "stray"]
    assert link.send(time.time()) == ["stored"]


@pytest.mark.parametrize("period_s", [12.0, 30.0, 600.0])
def test_a_slow_link_of_a_simulation(period_s: float) -> None:
    """Its samples are further apart than the history: the first gap costs one of them."""
    found = Link().send(*every(period_s, 50, 50 + 20 * period_s))
    assert found == ["stored", "stray", *["stored"] * 19]


def test_samples_of_one_message_are_counted_each() -> None:
    link = Link()
    link.put(*every(0.1, 100, 105))
    assert link.put(105.1, 5_000.0, 5_000.1) == ["stored", "stray", "stray"]
    assert set(link.put(*every(0.1, 7_000, 7_002))) == {"stored"}
    assert link.newest_s == 7_002


def test_a_call_means_its_stamp() -> None:
    tree = TransformTree()
    for stamp_s in (1, 100, 1_000_000, 1_700_000_000):
        assert tree.set_transform(StampedTransform("a", "b", stamp_s * S, Transform()))
    assert tree.frame("b").newest_stamp_ns == 1_700_000_000 * S


# --- against a plain model


@dataclass
class Model:
    """The rules of docs/explanation/clocks.md for stamps of a simulation, in seconds."""

    clears: bool
    kept: list[float] = field(default_factory=list)
    run: list[float] = field(default_factory=list)
    commits: int = 0
    left: float | None = None  # where the clock jumped ahead from
    gap: float = 0.0

    def put(self, stamp: float) -> str:
        if not self.kept or -T_S <= stamp - max(self.kept) <= T_S:
            return self._store(stamp)
        newest = max(self.kept)
        if stamp > newest:
            return self._ahead(stamp, newest)
        self._follow(stamp, T_S)
        returns = self.left is not None and abs(stamp - self.left) <= 3600
        may = self.clears and (newest - stamp <= DAY_S or self._goes_on())
        if self.commits < 2 or not (returns or may):
            return "late"
        self.kept, self.left = [], None
        return self._store(stamp)

    def _ahead(self, stamp: float, newest: float) -> str:
        if stamp - newest <= 2 * self.gap:
            return self._store(stamp)
        is_same = stamp - newest <= DAY_S
        before = self.run[-1] if self.run else None
        self._follow(stamp, DAY_S if is_same else T_S)
        if not self._goes_on():
            return "stray"
        if is_same and before is not None and newest < before < stamp and stamp - before > T_S:
            self.gap = stamp - before
        self.left = newest
        return self._store(stamp)

    def _follow(self, stamp: float, most: float) -> None:
        if self.run and stamp == self.run[-1]:
            return
        if not self.run or not 0 < stamp - self.run[-1] <= most:
            self.run, self.commits = [], 0
        self.run.append(stamp)
        self.commits += 1

    def _goes_on(self) -> bool:
        return len(self.run) >= 10 or self.run[-1] - self.run[0] >= 5

    def _store(self, stamp: float) -> str:
        self.kept = [each for each in self.kept if each >= max(stamp, *self.kept, stamp) - T_S]
        self.kept.append(stamp)
        self.run, self.commits = [], 0
        return "stored"


def history(choose: random.Random) -> Iterator[float]:
    """Stamps of a link: a clock that runs, with strays, pauses, loops and set-backs."""
    now = choose.uniform(0, 1e5)
    period = choose.choice([0.02, 0.1, 1.0, 4.0, 11.0])
    for _ in range(choose.randrange(3, 12)):
        for _ in range(choose.randrange(1, 25)):
            now = round(now + period, 3)
            yield now
        kind = choose.choice(["strays", "pause", "jump", "back", "late"])
        size = choose.choice([0.5, 9.0, 12.0, 100.0, 5_000.0, 90_000.0, 1e7])
        if kind == "strays":
            at = now + choose.choice([-1, 1]) * size
            for n in range(choose.randrange(1, 14)):
                yield round(at + n * period, 3)
        elif kind == "late":
            yield round(now - size, 3)
        elif kind == "pause":
            now += choose.choice([0.5, 9.0, 15.0, 600.0])
        else:
            now += size if kind == "jump" else -size


@pytest.mark.parametrize("time_jump", ["reject", "clear"])
def test_random_histories(time_jump: Literal["reject", "clear"]) -> None:
    for seed in range(300):
        stamps = list(history(random.Random(seed)))
        link, model = Link(time_jump), Model(time_jump == "clear")
        for n, stamp in enumerate(stamps):
            assert link.send(stamp) == [model.put(stamp)], (seed, n, stamps[: n + 1])
        assert link.newest_s == pytest.approx(max(model.kept)), seed
        assert link.tree.frame("wheel").samples == len(set(model.kept)), seed


# --- a server, and what it reports


@pytest.mark.parametrize(
    ("wall_s", "sim_s", "names"),
    [
        (1_770_000_000.0, 100.0, ("odom", "base", "wheel")),
        (1_600_000_000.0, 4_000.0, ("map", "robot", "mast")),
    ],
)
def test_the_publisher_of_the_strays_is_named(
    lend_server: LendServer, wall_s: float, sim_s: float, names: tuple[str, str, str]
) -> None:
    """ros/robot_state_publisher#202: and not that of the link above."""
    root, base, wheel = names
    server = lend_server("--time-jump", "reject")
    with server.connect() as tf:
        senders = f"{wheel} publisher", f"{base} odometry"
        state, odometry = map(tf.broadcaster, senders)
        sent, before = 0, tf.stats()["put_transforms"]
        for n, stamp_s in enumerate(every(0.02, sim_s, sim_s + 12)):
            stamp = round(stamp_s * S)
            odometry.send(StampedTransform(root, base, stamp, Transform((stamp_s, 0, 0))))
            state.send(StampedTransform(base, wheel, stamp, Transform()))
            if n == 300:
                for k in range(5):
                    stray = round((wall_s + 0.02 * k) * S)
                    state.send(StampedTransform(base, wheel, stray, Transform()))
            sent += 1
        wait_until(lambda: tf.stats()["put_transforms"] == before + 2 * sent, "stored")
        records = {each.name: each for each in tf.authorities()}
        assert records[senders[0]].refused_by_reason == {"stray": 5}
        assert records[senders[1]].refused == 0
        assert tf.frame(wheel).dropped == tf.frame(wheel).time_jumps == 0
        assert tf.lookup_transform(root, wheel, round((sim_s + 11.99) * S))
        done = command_line.run("--connect", server.endpoint, "doctor", "--for", "0", "--json")
        said = done.stdout
        assert "TF106" in said and senders[0] in said and f"'{wheel}'" in said
        assert "TF104" not in said and "TF204" not in said and "TF207" not in said
        explained = command_line.run("--connect", server.endpoint, "explain", root, wheel).stdout
        assert wheel in explained and "use_sim_time" not in explained
