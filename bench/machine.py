"""What the figures were measured on."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from importlib.metadata import version
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent


def describe() -> dict[str, str]:
    return {
        "cpu": _cpu(),
        "cores": str(os.cpu_count()),
        "load": load(),
        "system": platform.platform(),
        "compiler": _output("sh", "-c", '"$(sh scripts/compiler.sh)" --version'),
        "python": platform.python_version(),
        "zenoh_tf": version("zenoh-tf"),
        "commit": _output("git", "describe", "--always", "--dirty"),
        "eclipse_zenoh": version("eclipse-zenoh"),
        "numpy": np.__version__,
        "tf2": _tf2(),
    }


def load() -> str:
    """Runnable threads, averaged over 1, 5 and 15 minutes."""
    return " ".join(f"{average:.2f}" for average in os.getloadavg())


def _cpu() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _tf2() -> str:
    packages = [
        f"{name} {found}"
        for name in ("libtf2-dev", "python3-tf2")
        if (found := _output("dpkg-query", "-W", "-f", "${Version}", name))
    ]
    return ", ".join(packages) or "no package of Debian's"


def _output(*command: str) -> str:
    """The first line that a command prints; empty where it is missing or fails."""
    if shutil.which(command[0]) is None:
        return ""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    return lines[0].strip() if done.returncode == 0 and lines else ""
