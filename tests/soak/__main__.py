"""``python -m tests.soak``: hours of mixed load; memory, files and threads must reach a plateau.

Every sample is written at once to build/soak/samples.jsonl, so that ``--plot`` can draw a run that
is not over or was cut off. Exit status 1 if the server grows over the second half.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.attack.processes import ROOT, Process, Server
from tests.processes.server_costs import status_mb

from .load import KINDS
from .plot import draw

SAMPLES = ROOT / "build/soak/samples.jsonl"
FIGURE = ROOT / "docs/figures/soak.svg"
#: How much the server may grow over the second half, by a straight line through its samples.
BOUNDS = {"rss_mb": 3.0, "files": 4.0, "threads": 2.0}
#: Small limits, which a soak reaches, so that what is at a limit is tested too.
_FLAGS = ("--limit", "frames=3000", "--cache-time", "5s", "--log-level", "error")
_SAMPLES = 720
_WINDOW = 5  # samples whose median counts as one: a single peak is no growth


class Load:
    """A running load whose counters are read in a thread."""

    def __init__(self, process: Process) -> None:
        self.process = process
        self.counts: dict[str, int] = {}
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self.process.stdout:
            with contextlib.suppress(ValueError):
                self.counts = json.loads(line)


def sample(server: Server, loads: dict[str, Load], start_s: float) -> dict[str, Any]:
    folder = Path(f"/proc/{server.pid}")
    return {
        "s": round(time.monotonic() - start_s, 1),
        "rss_mb": round(status_mb(server.pid, "VmRSS"), 2),
        "files": len(list((folder / "fd").iterdir())),
        "threads": len(list((folder / "task").iterdir())),
        # A client that lives as long as the server does.
        "client_rss_mb": round(status_mb(loads["transactions"].process.pid, "VmRSS"), 2),
        "log_bytes": len(server.log),
        "counts": {name: load.counts for name, load in loads.items()},
    }


def growth(samples: list[dict[str, Any]], field: str) -> float:
    """The growth of a field over the second half, by a line through its samples."""
    half = [each for each in samples if each["s"] >= samples[-1]["s"] / 2]
    values = np.array([each[field] for each in half], float)
    smooth = np.array([np.median(values[i : i + _WINDOW]) for i in range(len(values))])
    times = np.array([each["s"] for each in half])
    slope = float(np.polyfit(times, smooth, 1)[0])
    return slope * float(times[-1] - times[0])


def soak(python: str, seconds: float) -> None:
    SAMPLES.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        output = stack.enter_context(SAMPLES.open("w"))
        server = stack.enter_context(Server(python, *_FLAGS))
        loads = {}
        for kind in KINDS:
            command = [sys.executable, "-m", "tests.soak.load", kind.__name__, server.endpoint]
            process = stack.enter_context(Process(command, folder=ROOT))
            loads[kind.__name__] = Load(process)
        start_s = time.monotonic()
        while (left_s := start_s + seconds - time.monotonic()) > 0:
            for name, load in loads.items():
                assert load.process.running, f"the load {name!r} has ended"
            assert server.running, server.log[-3000:]
            one = sample(server, loads, start_s)
            output.write(json.dumps(one) + "\n")
            output.flush()
            time.sleep(min(left_s, max(1.0, seconds / _SAMPLES)))


def judge(samples: list[dict[str, Any]]) -> bool:
    """Print what grew, and what became of the loads. True if all bounds are kept."""
    kept = True
    for field, bound in BOUNDS.items():
        grown = growth(samples, field)
        values = [each[field] for each in samples]
        kept &= grown <= bound
        mark = "ok" if grown <= bound else "GROWS"
        print(
            f"{field:8} {values[0]:g} to {values[-1]:g}, at most {max(values):g}; "
            f"{grown:+.2f} over the second half (bound {bound:g}): {mark}"
        )
    for name, counts in samples[-1]["counts"].items():
        print(f"{name:13} {counts}")
    if refused := samples[-1]["counts"]["churn"].get("LimitExceeded"):
        print(f"{refused} new frames were refused, although removed ones leave room")
        kept = False
    print(f"log: {samples[-1]['log_bytes']} bytes; {samples[-1]['s']:.0f} s")
    return kept


def read() -> list[dict[str, Any]]:
    lines = SAMPLES.read_text().splitlines()
    return [json.loads(line) for line in lines if line.endswith("}")]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--python", default=sys.executable, help="interpreter of the server")
    parser.add_argument("--plot", action="store_true", help="draw what was sampled so far")
    parser.add_argument("--figure", type=Path, default=FIGURE, help="default: %(default)s")
    options = parser.parse_args()
    if not options.plot:
        soak(options.python, options.seconds)
    samples = read()
    draw(samples, options.figure)
    return 0 if judge(samples) else 1


if __name__ == "__main__":
    sys.exit(main())
