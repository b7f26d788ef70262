"""Acknowledged static links survive kill -9 at any moment, and no commit survives in part.

`STATE_KILLS=500` sets how often the server is killed, `SEED` repeats a run.
"""

from __future__ import annotations

import functools
import os
import random
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.support.runs import seed
from tests.support.threads import beside
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import LookupException, OutcomeUnknown, ServerUnavailable
from zenoh_tf_client import TransformClient

pytestmark = pytest.mark.slow

KILLS = int(os.environ.get("STATE_KILLS", "10"))
WRITERS = 3
#: Links of one writer.
LINKS = 4

#: x of each static link, by its child frame.
Statics = dict[str, int]


@dataclass
class Writer:
    """Changes static links of its own, one write after another, and knows what must be stored."""

    number: int
    random: random.Random
    acknowledged: Statics = field(default_factory=dict)
    in_flight: Statics | None = None  # the links after the write that got no answer
    version: int = 0
    writes: int = 0

    def frames(self) -> list[str]:
        return [f"{self.number}/{link}" for link in range(LINKS)]

    def run(self, tf: TransformClient, killed: threading.Event) -> None:
        while not killed.is_set():
            self.in_flight = dict(self.acknowledged)
            try:
                self.write(tf, self.in_flight)
            except (OutcomeUnknown, ServerUnavailable):
                return
            self.acknowledged, self.in_flight = self.in_flight, None
            self.writes += 1

    def write(self, tf: TransformClient, after: Statics) -> None:
        """One write of a random kind; `after` becomes what the tree has then."""
        self.version += 1
        frame = self.random.choice(self.frames())
        kind = self.random.random()
        if kind < 0.6 or frame not in after:
            after.update(dict.fromkeys(self.frames(), self.version))
            tf.set_transforms_xact([self.link(name) for name in self.frames()], static=True)
        elif kind < 0.7:
            after[frame] = self.version
            tf.set_transform(self.link(frame), static=True)
        elif kind < 0.8:
            after[frame] = self.version
            with tf.batch() as batch:
                done = batch.set_transform(self.link(frame), static=True)
            assert done.result()
        elif kind < 0.9:
            del after[frame]
            tf.remove_frame(frame)
        else:  # the link becomes dynamic
            del after[frame]
            tf.set_transform(self.link(frame))

    def link(self, child: str) -> StampedTransform:
        return StampedTransform("map", child, self.version, Transform((self.version, 0, 0)))

    def check(self, tf: TransformClient) -> None:
        """After a restart the tree has what was acknowledged, or the write in flight as well."""
        found = {name: x for name in self.frames() if (x := static_x(tf, name)) is not None}
        assert found in (self.acknowledged, self.in_flight), (self.number, self.version)
        self.acknowledged, self.in_flight = found, None


def static_x(tf: TransformClient, frame: str) -> int | None:
    """x of a static link; None if there is none."""
    try:
        assert tf.frame(frame).static
    except LookupException:
        return None
    return round(float(tf.lookup_transform("map", frame).transform.translation[0]))


@pytest.mark.timeout(60 + 20 * KILLS)
def test_acknowledged_statics_survive_kills(start_server: StartServer, tmp_path: Path) -> None:
    number = seed("STATE_KILLS" in os.environ)
    print(f"SEED={number}")
    chance = random.Random(number)
    folder, endpoint = tmp_path / "state", free_endpoint()
    flags = ("--state-dir", str(folder))
    writers = [Writer(number, random.Random(chance.random())) for number in range(WRITERS)]
    kill_at_start(endpoint, flags, 0.2 + chance.random() * 0.5)  # while the file is made
    for _ in range(KILLS):
        server = start_server(*flags, endpoint=endpoint)
        with server.connect() as tf:
            for writer in writers:
                writer.check(tf)
            with beside(*(functools.partial(writer.run, tf) for writer in writers)):
                time.sleep(chance.random() * 0.3)
                server.kill()
        if chance.random() < 0.1:
            kill_at_start(endpoint, flags, chance.random())  # while it restores
    with start_server(*flags, endpoint=endpoint).connect() as tf:
        for writer in writers:
            writer.check(tf)
    writes = sum(writer.writes for writer in writers)
    print(f"{KILLS} kills, {writes} acknowledged writes")
    assert writes >= KILLS, "the writers were too slow to prove anything"


def kill_at_start(endpoint: str, flags: tuple[str, ...], after_s: float) -> None:
    process = forks.Popen(
        [sys.executable, "-m", "zenoh_tf_server", "--listen", endpoint, *flags],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    time.sleep(after_s)
    process.kill()
    process.wait()
