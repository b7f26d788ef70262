"""What the benchmarks ran on."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def describe() -> dict[str, str]:
    return {
        "cpu": _cpu(),
        "cores": str(os.cpu_count()),
        "load": load(),
        "system": platform.platform(),
        "compiler": _output("sh", "-c", '"$(sh scripts/compiler.sh)" --version'),
        "python": platform.python_version(),
        "commit": _output("git", "describe", "--always", "--dirty"),
        **{name: _version(name) for name in ("zenoh-tf", "eclipse-zenoh", "numpy")},
        "tf2": _tf2(),
    }


def load() -> str:
    """Runnable threads, averaged over 1, 5 and 15 minutes."""
    return " ".join(f"{average:.2f}" for average in os.getloadavg())


class BackgroundLoad:
    """The processor time that other programs than one process use from now on."""

    def __init__(self, pid: int) -> None:
        self._pid, self._start = pid, time.monotonic()
        self._before_s = self._others_s()

    def cores(self) -> float:
        spent_s = self._others_s() - self._before_s
        return max(0.0, spent_s / (time.monotonic() - self._start))

    def _others_s(self) -> float:
        user, nice, system, _, _, *rest = Path("/proc/stat").read_text().split("\n")[0].split()[1:]
        ticks = map(int, (user, nice, system, *rest[:3]))
        return sum(ticks) / os.sysconf("SC_CLK_TCK") - cpu_s(self._pid)


def cpu_s(pid: int) -> float:
    """The processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _cpu() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _tf2() -> str:
    query = ("dpkg-query", "-W", "-f", "${Version}")
    versions = {name: _output(*query, name) for name in ("libtf2-dev", "python3-tf2")}
    found = [f"{name} {version}" for name, version in versions.items() if version]
    return ", ".join(found) or "no Debian package"


def _output(*command: str) -> str:
    """The first line that a command prints; empty if it is missing or fails."""
    if shutil.which(command[0]) is None:
        return ""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.split("\n")[0].strip() if done.returncode == 0 else ""
