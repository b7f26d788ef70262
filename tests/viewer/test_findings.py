"""The doctor beside the viewer."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from zenoh_tf import ServerUnavailable, StampedTransform, Transform, TransformTree
from zenoh_tf.doctor import LinkFacts, TreeFacts
from zenoh_tf_tools.viewer.findings import Findings

WAIT_S = 60


class Observed:
    """Two trees that are not connected, and how often they were observed."""

    def __init__(self) -> None:
        self.times = threading.Semaphore(0)
        self.tree = TransformTree()
        for parent, child in (("map", "base"), ("world", "ball")):
            self.tree.set_transform(StampedTransform(parent, child, 1, Transform()), static=True)

    def __call__(self, stopped: Callable[[], bool]) -> TreeFacts:
        self.times.release()
        frames = [self.tree.frame(name) for name in self.tree.frames()]
        return TreeFacts([LinkFacts(frame) for frame in frames], 1)


def test_faults_are_found_while_someone_looks() -> None:
    looks = threading.Event()
    observed = Observed()
    findings = Findings(observed, once=True, wanted=looks.is_set)
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
    findings = Findings(observed, once=False, wanted=lambda: False)
    findings.close()
    assert not observed.times.acquire(blocking=False)


def test_a_server_that_is_away_is_asked_again() -> None:
    observed = Observed()

    def away_at_first(stopped: Callable[[], bool]) -> TreeFacts:
        facts = observed(stopped)
        if not asked.is_set():
            asked.set()
            raise ServerUnavailable("no reply")
        return facts

    asked = threading.Event()
    findings = Findings(away_at_first, once=False, wanted=lambda: True)
    assert observed.times.acquire(timeout=WAIT_S)
    assert observed.times.acquire(timeout=WAIT_S)
    findings.close()
    assert findings.found


@pytest.mark.timeout(WAIT_S)
def test_closing_stops_an_observation() -> None:
    begun = threading.Event()

    def long(stopped: Callable[[], bool]) -> TreeFacts:
        begun.set()
        while not stopped():
            pass
        return TreeFacts([], 0)

    findings = Findings(long, once=True, wanted=lambda: True)
    begun.wait()
    findings.close()
    assert findings.found == []
