"""What a request costs a server process, in memory and processor time (Linux)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.support.raw import Raw
from zenoh_tf import wire
from zenoh_tf._core import TransformRows

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(slots=True)
class Cost:
    """Of what ran in the block of `cost_of`."""

    peak_mb: float = 0.0  # above what was resident before
    kept_mb: float = 0.0  # that stayed resident
    cpu_s: float = 0.0


def _status_mb(pid: int, name: str) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) / 1024
    raise KeyError(name)


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


@contextmanager
def cost_of(pid: int) -> Iterator[Cost]:
    """Measure a process during the block."""
    Path(f"/proc/{pid}/clear_refs").write_text("5")  # resets the peak
    before_mb, before_s = _status_mb(pid, "VmRSS"), _cpu_s(pid)
    cost = Cost()
    yield cost
    cost.peak_mb = _status_mb(pid, "VmHWM") - before_mb
    cost.kept_mb = _status_mb(pid, "VmRSS") - before_mb
    cost.cpu_s = _cpu_s(pid) - before_s


def commit(names: list[str], parent: list[int], child: list[int], **more: object) -> bytes:
    """A commit of identities at time 1."""
    rows = len(parent)
    body = wire.commit_body(
        wire.Commit(
            TransformRows(
                names,
                np.array(parent, np.uint32),
                np.array(child, np.uint32),
                np.ones(rows, np.int64),
                np.tile([0.0, 0, 0, 0, 0, 0, 1], (rows, 1)),
            )
        ),
        more,
    )
    return wire.pack(body)


def fill_star(wires: Raw, frames: int, prefix: str = "frame") -> None:
    """Make `frames` frames below "root"."""
    done = 0
    while done < frames:
        n = min(100_000, frames - done)
        names = ["root", *(f"{prefix}{row}" for row in range(done, done + n))]
        reply = wires.query("commit", commit(names, [0] * n, list(range(1, n + 1))), 60.0)
        assert "error" not in reply, reply["error"]
        done += n


def fill_chain(wires: Raw, depth: int, prefix: str) -> None:
    """Make the frames `prefix`1 to `prefix`depth, each the parent of the next, below "root"."""
    names = ["root", *(f"{prefix}{row}" for row in range(1, depth + 1))]
    rows = range(depth)
    reply = wires.query("commit", commit(names, list(rows), [row + 1 for row in rows]), 60.0)
    assert "error" not in reply, reply["error"]


def lookup(rows: int, target: str, source: str, **more: object) -> wire.Message:
    """A lookup of one pair at the latest common time, `rows` times."""
    return {
        "v": 1,
        "names": [target, source],
        "op": bytes([wire.OP_COMMON]) * rows,
        "target": np.zeros(rows, np.uint32).tobytes(),
        "source": np.ones(rows, np.uint32).tobytes(),
        "stamp": np.full(rows, wire.NO_STAMP).tobytes(),
        **more,
    }
