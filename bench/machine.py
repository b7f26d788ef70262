"""What the benchmarks ran on, what else it did meanwhile, and of which commit the code is."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TICK_S = 1 / os.sysconf("SC_CLK_TCK")
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
#: Above it, results are refused: the load average of the last minute.
MAX_LOAD = 1.0
#: What cannot change a measurement, as git's pathspecs: the one list of it.
UNMEASURED = (
    *("*.md", "docs", "tests", "examples", "docker", ".ci", ".github", "mkdocs.yml", "Makefile"),
    *(
        "LICENSE",
        ".gitignore",
        ".dockerignore",
        ".clang-format",
        "scripts/checks",
        "scripts/docs_pages.py",
        "bench/results",
    ),
    *("bench/results.py", "bench/numbers.py", "bench/plots.py", "bench/figures.py"),
)


def describe() -> dict[str, str]:
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    tf2 = _output("dpkg-query -W -f '${Package} ${Version}, ' libtf2-dev python3-tf2")
    return {
        "cpu": model[1] if model else platform.machine(),
        "cores": str(os.cpu_count()),
        "memory": f"{os.sysconf('SC_PHYS_PAGES') * PAGE_BYTES / 2**30:.1f} GiB",
        "system": platform.platform(),
        "compiler": _output('"$(sh scripts/compiler.sh)" --version'),
        "python": platform.python_version(),
        "tf2": tf2.rstrip(", ") or "no Debian package",
    }


def commit() -> str:
    """The hash of the checkout's commit; ends in -dirty if measured files differ from it."""
    return _output("git rev-parse HEAD") + ("-dirty" if _git("status", "--porcelain") else "")


def changed_since(measured: str) -> list[str]:
    """The files that can change a measurement, and differ from the commit that was measured."""
    if measured.endswith("-dirty"):
        return ["files that the measured commit did not have"]
    return _git("diff", "--name-only", measured)


def load() -> float:
    return os.getloadavg()[0]


def cpu_s(pid: int) -> float:
    """The processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICK_S


def resident_mb(pid: int | str = "self") -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_BYTES / 1e6


class Background:
    """How many cores programs that this process did not start use, from now on."""

    def __init__(self) -> None:
        self._begun_s, self._others_s = time.monotonic(), _others_s()

    def cores(self) -> float:
        """Counts the children that have ended."""
        spent_s = _others_s() - self._others_s
        return max(0.0, spent_s / (time.monotonic() - self._begun_s))


def _others_s() -> float:
    ticks = [int(word) for word in Path("/proc/stat").read_text().split()[1:9]]
    busy_s = (sum(ticks) - sum(ticks[3:5])) * TICK_S  # less idle and waiting
    return busy_s - sum(os.times()[:4])


def _output(command: str) -> str:
    """The first line that a shell command prints; empty if it prints nothing."""
    return subprocess.getoutput(f"cd {ROOT}; {command} 2>/dev/null").partition("\n")[0]


def _git(*command: str) -> list[str]:
    """What git prints about the measured files; ends the benchmark if git fails."""
    paths = ["--", ".", *(f":!{path}" for path in UNMEASURED)]
    command = ("git", *command, *paths)
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if found.returncode:
        raise SystemExit(f"{' '.join(command)}: {found.stderr.strip()}")
    return found.stdout.splitlines()
