"""The core without Python, beside the real tf2: builds and runs bench/core."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from bench.machine import ROOT

_BUILD = ROOT / "build/bench"


def measure() -> Any:
    """Lookups at depth 4. Prints its own table; the driver's JSON."""
    return run("lookups")


def run(part: str, *flags: str) -> Any:
    """The JSON of one part of the driver, which is built first where that is needed."""
    _build()
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder, "raw.json")
        subprocess.run([_BUILD / "bench_core", part, *flags, "--json", raw], check=True)
        return json.loads(raw.read_text())


@functools.cache
def _build() -> None:
    """Once: all parts of a run are of the same program."""
    scripts = Path(sys.executable).parent
    environment = os.environ | {"PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
    compiler = subprocess.check_output(["sh", "scripts/compiler.sh"], cwd=ROOT, text=True).strip()
    for command in (
        ["cmake", "-S", "bench/core", "-B", str(_BUILD), "-G", "Ninja", "--log-level=WARNING"],
        ["cmake", "--build", str(_BUILD), "--", "--quiet"],
    ):
        subprocess.run(
            command,
            cwd=ROOT,
            env=environment | {"CXX": compiler},
            check=True,
            stdout=sys.stderr,
        )
