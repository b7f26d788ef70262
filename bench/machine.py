"""What the benchmarks ran on, what else it did meanwhile, and of which commit the code is."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TICK_S = 1 / os.sysconf("SC_CLK_TCK")
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
#: What cannot change a measurement, as git's pathspecs: the one list of it.
UNMEASURED = (
    *("*.md", "docs", "tests", "examples", "docker", ".ci", ".github", "mkdocs.yml", "Makefile"),
    *("LICENSE", ".gitignore", ".dockerignore", ".clang-format"),
    *("scripts/checks", "scripts/docs_pages.py"),
    *("bench/results", "bench/published-2022.json", "bench/results.py", "bench/figures.py"),
)


def describe() -> dict[str, str]:
    return {
        "cpu": _lines("sed -n 's/^model name\\s*: //p' /proc/cpuinfo; uname -m")[0],
        "cores": str(os.cpu_count()),
        "memory": f"{os.sysconf('SC_PHYS_PAGES') * PAGE_BYTES / 2**30:.1f} GiB",
        "system": platform.platform(),
        "compiler": _lines('"$(sh scripts/compiler.sh)" --version')[0],
        "python": platform.python_version(),
        "tf2": ", ".join(_lines("dpkg-query -W libtf2-dev python3-tf2 || true")).replace("\t", " "),
    }


def commit() -> str:
    """The hash of the checkout's commit; ends in -dirty if measured files differ from it."""
    dirty = _lines(f"git status --porcelain {_measured()}")
    return _lines("git rev-parse HEAD")[0] + ("-dirty" if dirty else "")


def changed_since(measured: str) -> list[str]:
    """The files that can change a measurement, and differ from the commit that was measured."""
    if measured.endswith("-dirty"):
        return ["files that the measured commit did not have"]
    return _lines(f"git diff --name-only {measured} {_measured()}")


def load() -> float:
    """The load average of the last minute."""
    return os.getloadavg()[0]


def cpu_s(pid: int) -> float:
    """The processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICK_S


class Usage:
    """Within its context: the seconds that pass, the processor time of processes, and by how much
    counts change, such as a server's."""

    def __init__(self, *pids: int, counts: Callable[[], Mapping[str, float]] = dict) -> None:
        self._pids, self._counts = pids, counts

    def __enter__(self) -> Usage:
        self._before, self._begun_s = self._counts(), time.monotonic()
        self._spent_s = [cpu_s(pid) for pid in self._pids]
        return self

    def __exit__(self, *_: object) -> None:
        spent_s = zip(self._pids, self._spent_s, strict=True)
        self.cpu_s = [cpu_s(pid) - before_s for pid, before_s in spent_s]
        self.took_s = time.monotonic() - self._begun_s
        self.counted = {name: n - self._before[name] for name, n in self._counts().items()}


def resident_mb(pid: int | str = "self") -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_BYTES / 1e6


def proportional_mb(pid: int) -> float:
    """What a process has in memory; what it shares with others counts in parts."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) * 1024 / 1e6


def others_s() -> float:
    """The processor time that programs have used which this process did not start; children count
    as others until they have ended."""
    ticks = [int(word) for word in Path("/proc/stat").read_text().split()[1:9]]
    busy_s = (sum(ticks) - sum(ticks[3:5])) * TICK_S  # less idle and waiting
    return busy_s - sum(os.times()[:4])


def _measured() -> str:
    return shlex.join(["--", ".", *(f":!{path}" for path in UNMEASURED)])


def _lines(command: str) -> list[str]:
    """The lines that a shell command prints; ends the benchmark if it fails."""
    done = subprocess.run(
        command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{command}: {done.stderr.strip()}")
    return done.stdout.splitlines()
