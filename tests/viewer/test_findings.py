"""The doctor beside the viewer."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Generator

import pytest

from zenoh_tf import ServerUnavailable, StampedTransform, Transform, TransformTree
from zenoh_tf_tools.doctor import LinkFacts, TreeFacts
from zenoh_tf_tools.viewer import findings as findings_module
from zenoh_tf_tools.viewer.findings import Findings

WAIT_S = 60


class Observed:
    """Two trees that are not connected, and how often they were observed."""

    def __init__(self) -> None:
        self.times = threading.Semaphore(0)
        self.tree = TransformTree()
        for parent, child in (("map", "base"), ("world", "ball")):
            self.tree.set_transform(StampedTransform(parent, child, 1, Transform()), static=True)

    def __call__(self, stopped: Callable[[], bool]) -> Generator[TreeFacts, None, None]:
        self.times.release()
        frames = [self.tree.frame(name) for name in self.tree.frames()]
        yield TreeFacts([LinkFacts(frame) for frame in frames], 1)


def test_faults_are_found_while_someone_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(findings_module, "_PAUSE_S", 0.01)
    looks = threading.Event()
    observed = Observed()
    findings = Findings(observed, wanted=looks.is_set)
    assert findings.found is None
    assert findings.of_frames() == {}
    looks.set()
    findings._thread.join(WAIT_S)  # a recording is observed once
    assert findings.found is not None
    [fault] = findings.found
    assert fault.fault.id == "TF301"
    assert findings.of_frames() == {fault.subject: fault.fault.title}
    assert findings.of(fault.subject) == [fault]
    assert findings.of("base") == []
    findings.close()


def test_nothing_is_observed_while_nobody_looks() -> None:
    observed = Observed()
    findings = Findings(observed, wanted=lambda: False)
    findings.close()
    assert not observed.times.acquire(blocking=False)


def test_a_server_that_is_away_is_asked_again() -> None:
    observed = Observed()

    def away_at_first(stopped: Callable[[], bool]) -> Generator[TreeFacts, None, None]:
        if not asked.is_set():
            asked.set()
            observed.times.release()
            raise ServerUnavailable("no reply")
        yield from observed(stopped)

    asked = threading.Event()
    findings = Findings(away_at_first, wanted=lambda: True)
    assert observed.times.acquire(timeout=WAIT_S)
    assert observed.times.acquire(timeout=WAIT_S)
    findings.close()
    assert findings.found


@pytest.mark.timeout(WAIT_S)
def test_one_observation_goes_on_until_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(findings_module, "_PAUSE_S", 0.01)
    looks, closed = threading.Event(), threading.Event()
    counts: list[int] = []

    def observe(stopped: Callable[[], bool]) -> Generator[TreeFacts, None, None]:
        try:
            for count in itertools.count():
                counts.append(count)
                if count == 3:
                    looks.clear()
                yield TreeFacts([], 0)
        finally:
            closed.set()

    looks.set()
    findings = Findings(observe, wanted=looks.is_set)
    closed.wait()
    assert counts == [0, 1, 2, 3]
    closed.clear()
    looks.set()
    closed.wait()
    assert counts == [0, 1, 2, 3] * 2
    findings.close()


@pytest.mark.timeout(WAIT_S)
def test_closing_stops_an_observation() -> None:
    begun = threading.Event()

    def long(stopped: Callable[[], bool]) -> Generator[TreeFacts, None, None]:
        begun.set()
        while not stopped():
            pass
        yield TreeFacts([], 0)

    findings = Findings(long, wanted=lambda: True)
    begun.wait()
    findings.close()
    assert findings.found == []
