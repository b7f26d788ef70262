"""The state file follows the tree while many threads change the same frames."""

from __future__ import annotations

import asyncio
import random
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.support.runs import CONTROLS
from tests.support.threads import switching, together
from zenoh_tf import TransformTree, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import NotDurable, TransformException
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.requests.service import Service
from zenoh_tf_server.state import writer as state_writer
from zenoh_tf_server.state.file import Changes, StateFile, StoredLink, Table
from zenoh_tf_server.state.state import StateSettings, StoredState

FRAMES = [f"frame {number}" for number in range(6)]
THREADS = 4
WRITES = 400
ROUNDS = 5
NEVER = (1 << 63) - 1


def commit(names: list[str], x: int, *, static: bool) -> wire.Commit:
    rows = TransformRows.of_tuples(("map", name, x, (x, 0, 0, 0, 0, 0, 1.0)) for name in names)
    return wire.Commit(rows, f"x{x % 3}", static)


def put(service: Service, what: wire.Commit) -> None:
    """Commit as a put. Raises what refuses it."""
    what.drop_old = True
    (outcome,) = service.commit_puts([what])
    if isinstance(outcome, Exception):
        raise outcome


def write_at_random(service: Service, state: StoredState, seed: int) -> None:
    chance = random.Random(seed)
    for number in range(WRITES):
        names = chance.sample(FRAMES, chance.randint(1, 3))
        kind = chance.random()
        try:
            if kind < 0.45:
                put(service, commit(names, seed * WRITES + number, static=True))
            elif kind < 0.9:
                put(service, commit(names, seed * WRITES + number, static=False))
            else:
                state.links.remove_frame(names[0], subtree=False, expires_ns=NEVER)
        except TransformException:  # the frame was removed already, or the stamp is too old
            continue


def statics(tree: TransformTree) -> dict[str, tuple[str, int, float]]:
    found = {}
    for name in tree.frames():
        record = tree._frame_record(name)
        if record["static"]:
            x = float(tree.lookup_transform("map", name).transform.translation[0])
            found[name] = (record["authority"], record["newest_stamp_ns"], x)
    return found


@pytest.mark.parametrize("concurrency", CONTROLS)
def test_the_file_has_what_the_tree_has(tmp_path: Path, concurrency: str) -> None:
    chance = random.SystemRandom().randrange(1 << 20)
    print(f"seed {chance}")
    loop = asyncio.new_event_loop()
    limits = Limits()
    for round_ in range(ROUNDS):
        tree = TransformTree(1e6, concurrency)  # type: ignore[arg-type]
        state = StoredState(StateSettings(tmp_path), tree, "main", limits)
        service = Service(tree, "main", "instance", limits, loop, state.links)
        state.links.reset(NEVER)
        seeds = range(chance + THREADS * round_, chance + THREADS * (round_ + 1))
        with switching(1e-6):  # so that threads meet between any two steps
            together(*(partial(write_at_random, service, state, seed) for seed in seeds))
        expected = statics(tree)
        service.close()
        state.close()
        file = StateFile(tmp_path, "main")
        stored = file.read().static_links
        file.close()
        assert {
            name: (link.authority, link.stamp_ns, link.pose[0]) for name, link in stored.items()
        } == expected
    loop.close()


class OvertakenTree:
    """A tree whose next static commit is followed by another call, before the commit returns."""

    def __init__(self, tree: TransformTree) -> None:
        self.tree = tree
        self.then: Callable[[], None] | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.tree, name)

    def _commit_rows(self, *arguments: Any, **options: Any) -> Any:
        stored = self.tree._commit_rows(*arguments, **options)
        if options["static"] and self.then is not None:
            then, self.then = self.then, None
            then()
        return stored


def test_a_dynamic_commit_right_after_a_static_one(tmp_path: Path) -> None:
    tree: Any = OvertakenTree(TransformTree())
    loop, limits = asyncio.new_event_loop(), Limits()
    state = StoredState(StateSettings(tmp_path), tree, "main", limits)
    service = Service(tree, "main", "instance", limits, loop, state.links)
    dynamic = threading.Thread(target=lambda: put(service, commit(["a"], 2, static=False)))

    def overtake() -> None:
        dynamic.start()
        while tree._frame_record("a")["static"]:
            time.sleep(0.001)
        dynamic.join(0.1)  # it may have to wait for the static commit

    tree.then = overtake
    put(service, commit(["a", "b"], 1, static=True))
    dynamic.join()
    service.close()
    state.close()
    file = StateFile(tmp_path, "main")
    assert list(file.read().static_links) == ["b"]
    file.close()
    loop.close()


def test_a_transaction_is_stored_whole_or_not(tmp_path: Path) -> None:
    file = StateFile(tmp_path, "main")
    good = StoredLink("map", 1, (0.0,) * 6 + (1.0,), "a")
    file.write({(Table.STATIC_LINKS, "before"): good})
    bad = good._replace(parent=object())  # type: ignore[arg-type]
    with pytest.raises(Exception, match="serialize"):
        file.write({(Table.STATIC_LINKS, "first"): good, (Table.STATIC_LINKS, "second"): bad})
    file.write({(Table.STATIC_LINKS, "after"): good})
    assert file.read().static_links == {"before": good, "after": good}
    file.close()


class HangingFile:
    """A state file on a disk that does not answer until it is released."""

    path = Path("disk")

    def __init__(self) -> None:
        self.released = threading.Event()
        self.written: list[Changes] = []
        self.is_closed = False

    def write(self, changes: Changes) -> None:
        assert self.released.wait(30)
        self.written.append(changes)

    def close(self) -> None:
        self.is_closed = True


def test_a_disk_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state_writer, "WAIT_S", 0.2)
    file: Any = HangingFile()
    writer = state_writer.StateWriter(file)
    link = StoredLink("map", 1, (0.0,) * 6 + (1.0,), "a")
    tickets = [writer.put({(Table.STATIC_LINKS, name): link}) for name in ("a", "b")]
    with pytest.raises(NotDurable, match=r"the disk did not answer within 0\.2 s"):
        writer.wait(tickets[0])
    monkeypatch.setattr(state_writer, "WAIT_S", 0.1)  # less than the first has waited
    with pytest.raises(NotDurable):
        writer.wait(tickets[1])
    file.released.set()
    while writer.pending:
        time.sleep(0.01)
    for ticket in tickets:
        writer.wait(ticket)
    assert {key for changes in file.written for key in changes} == {
        (Table.STATIC_LINKS, "a"),
        (Table.STATIC_LINKS, "b"),
    }
    writer.close()
    assert file.is_closed
