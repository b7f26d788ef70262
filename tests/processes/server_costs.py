"""What a request costs a server process, in memory and processor time (Linux)."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.support import messages
from tests.support.raw import Raw
from zenoh_tf import wire

#: Clock id of the processor time of a process, as Linux makes it of a process id.
_CPU_CLOCK = 2


@dataclass(slots=True)
class Cost:
    """Of what ran in the block of `cost_of`. Of a process that has ended it is infinite or NaN."""

    peak_mb: float = 0.0  # above what was resident before
    kept_mb: float = 0.0  # that stayed resident
    cpu_s: float = 0.0
    wall_s: float = 0.0


def status_mb(pid: int, field: str) -> float:
    """A size of a process from /proc, such as VmRSS (now) or VmHWM (peak). NaN if it has ended."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith(field + ":"):
                return int(line.split()[1]) / 1024
    return math.nan


def cpu_s(pid: int) -> float:
    """The processor time that all threads of a process have used."""
    try:
        return time.clock_gettime(((~pid) << 3) | _CPU_CLOCK)
    except OSError:  # it has ended
        return math.inf


@contextmanager
def cost_of(pid: int, settle_s: float = 0.0) -> Iterator[Cost]:
    """Measure a process during the block. What it keeps is measured `settle_s` later."""
    Path(f"/proc/{pid}/clear_refs").write_text("5")  # resets the peak
    before_mb, start_s, before_s = status_mb(pid, "VmRSS"), time.monotonic(), cpu_s(pid)
    cost = Cost()
    yield cost
    cost.wall_s = time.monotonic() - start_s
    cost.cpu_s = cpu_s(pid) - before_s
    cost.peak_mb = status_mb(pid, "VmHWM") - before_mb
    time.sleep(settle_s)
    cost.kept_mb = status_mb(pid, "VmRSS") - before_mb


def fill_star(wires: Raw, frames: int, prefix: str = "frame") -> None:
    """Make `frames` frames below "root"."""
    for done in range(0, frames, 100_000):
        star = messages.star(prefix, done, min(100_000, frames - done))
        reply = wires.query("commit", star, 60.0)
        assert "error" not in reply, reply["error"]


def fill_chain(wires: Raw, depth: int, prefix: str, root: str = "root") -> None:
    """Make the frames `prefix`1 to `prefix`depth, each the parent of the next, below `root`."""
    names = [root, *(f"{prefix}{row}" for row in range(1, depth + 1))]
    links = messages.commit(names, range(depth), range(1, depth + 1))
    reply = wires.query("commit", links, 60.0)
    assert "error" not in reply, reply["error"]


def lookup(rows: int, target: str, source: str, **more: object) -> wire.Message:
    """A lookup of one pair at the latest common time, `rows` times."""
    options = {"op": wire.OP_COMMON, "stamp_ns": wire.NO_STAMP, **more}
    return messages.same_lookup(rows, target, source, **options)
