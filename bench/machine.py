"""What the benchmarks ran on, and what else it did meanwhile."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TICK_S = 1 / os.sysconf("SC_CLK_TCK")


def describe() -> dict[str, str]:
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    tf2 = _output("dpkg-query -W -f '${Package} ${Version}, ' libtf2-dev python3-tf2")
    return {
        "cpu": model[1] if model else platform.machine(),
        "cores": str(os.cpu_count()),
        "load": " ".join(f"{average:.2f}" for average in os.getloadavg()),
        "system": platform.platform(),
        "compiler": _output('"$(sh scripts/compiler.sh)" --version'),
        "python": platform.python_version(),
        "commit": _output("git describe --always --dirty"),
        "tf2": tf2.rstrip(", ") or "no Debian package",
    }


def cpu_s(pid: int) -> float:
    """The processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICK_S


def others_s(pid: int) -> float:
    """The processor time that all programs but one have used."""
    ticks = [int(word) for word in Path("/proc/stat").read_text().split()[1:9]]
    return (sum(ticks) - sum(ticks[3:5])) * TICK_S - cpu_s(pid)  # less idle and waiting


def _output(command: str) -> str:
    """The first line that a shell command prints; empty if it prints nothing."""
    return subprocess.getoutput(f"cd {ROOT}; {command} 2>/dev/null").partition("\n")[0]
