"""Gates: stamps that go back, threads that do not start, and sources that fail."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from zenoh_tf import Dropped, Gate, StampedTransform, TransformTree

from .test_gate import LONG_S, at


class FaultySource:
    """A tree whose lookups fail as nothing should, a few times."""

    def __init__(self, faults: int) -> None:
        self.tree = TransformTree()
        self.tree.set_transforms_xact([at(100), at(200)])
        self.faults = faults

    def lookup_transform(self, *args: Any, **options: Any) -> StampedTransform:
        self._fail()
        return self.tree.lookup_transform(*args, **options)

    def lookup_transforms(self, *args: Any, **options: Any) -> Any:
        self._fail()
        return self.tree.lookup_transforms(*args, **options)

    def _fail(self) -> None:
        self.faults -= 1
        if self.faults >= 0:
            raise RuntimeError("boom")


def test_stamps_that_go_back_take_two_threads() -> None:
    tree = TransformTree()
    tree.set_transforms_xact([at(10**6), at(10**6 + 1)])
    with tree.gate("map", queue_size=2_000, timeout_s=LONG_S) as gate:
        most = 0
        for number in range(300):
            gate.put(number, "base", 2 * 10**6 - number)
            while not tree.stats()["waiters"]:
                pass
            most = max(most, sum(one.name == "gate" for one in threading.enumerate()))
        assert most <= 2
        gate.put("early", "base", 10**6)  # not held up by the waits for newer ones
        assert gate.get(LONG_S).item == "early"
        tree.set_transform(at(2 * 10**6))
        assert {gate.get(LONG_S).item for _ in range(300)} == set(range(300))


def test_a_thread_that_does_not_start(monkeypatch: pytest.MonkeyPatch) -> None:
    tree = TransformTree()
    tree.set_transforms_xact([at(100), at(200)])

    def fail(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with tree.gate("map", timeout_s=LONG_S) as gate:
        with monkeypatch.context() as patched:
            patched.setattr(threading.Thread, "start", fail)
            with pytest.raises(RuntimeError, match="can't start"):
                gate.put("first", "base", 150)
        assert gate.stats()["held"] == 0
        gate.put("second", "base", 150)
        assert gate.get(LONG_S).item == "second"


@pytest.mark.parametrize("faults", [1, 2, 4])
def test_a_source_that_fails_is_asked_again(faults: int, caplog: Any) -> None:
    with Gate(FaultySource(faults), "map", 10, LONG_S, None) as gate:
        gate.put("item", "base", 150)
        assert gate.get(LONG_S).item == "item"
    assert len([one for one in caplog.records if one.exc_info]) == 1


def test_items_of_a_source_that_fails_time_out() -> None:
    drops: list[Dropped[Any]] = []
    done = threading.Event()

    def on_drop(dropped: Dropped[Any]) -> None:
        drops.append(dropped)
        done.set()

    with Gate(FaultySource(10**9), "map", 10, 0.2, on_drop) as gate:
        gate.put("item", "base", 150)
        assert done.wait(LONG_S)
    assert (drops[0].reason, "boom" in str(drops[0].error)) == ("timeout", True)
