"""The demo ends by itself, shows what it claims, and leaves no process behind."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

DEMO = Path(__file__).resolve().parents[2] / "examples" / "demo.py"


def start() -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(DEMO)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def endpoint_of(page: str) -> str:
    found = re.search(r"tcp/127\.0\.0\.1:\d+", page)
    assert found is not None, page
    return found[0]


def processes_of(endpoint: str) -> list[int]:
    """Return the processes with the demo's endpoint, which no other process has, as an argument."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                arguments = (entry / "cmdline").read_bytes().decode(errors="replace")
            except OSError:
                continue  # the process has just ended
            if endpoint in arguments:
                found.append(int(entry.name))
    return found


def test_make_demo_installs_what_it_needs_and_says_how_long_it_takes() -> None:
    """The first `make demo` takes minutes, most of them for pip and the compiler."""
    steps = subprocess.run(
        ["make", "--dry-run", "--always-make", "demo"],
        cwd=DEMO.parent.parent,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "scripts/venv.sh runtime" in steps
    assert "scripts/venv.sh dev" not in steps
    assert re.search(r'echo "building the native module: about \d+ minutes', steps)


@pytest.mark.slow
def test_demo() -> None:
    with start() as demo:
        page, errors = demo.communicate(timeout=150)
    assert demo.returncode == 0, errors
    assert errors == ""
    assert "interpolate" in page
    assert "latest common" in page
    row = re.search(r"one transactional lookup\s+([\d,]+)\s+0\n", page)
    assert row is not None and int(row[1].replace(",", "")) > 0
    assert len(re.findall(r"\d Hz\s+\d+\.\d Hz\s+\d+\.\d Hz", page)) == 3
    methods = re.findall(r"(a query|the server's memory|a mirror) +([\d.,]+) us", page)
    assert (methods[0][0], methods[-1][0]) == ("a query", "a mirror")
    assert all(float(us.replace(",", "")) > 0 for _, us in methods)
    assert processes_of(endpoint_of(page)) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted_demo_ends_its_children(number: signal.Signals) -> None:
    with start() as demo:
        assert demo.stdout is not None and demo.stderr is not None
        page = ""
        while "tcp/" not in page:
            page += demo.stdout.readline()
        endpoint = endpoint_of(page)
        while len(processes_of(endpoint)) < 5:  # the server and four sensors
            assert demo.poll() is None
            time.sleep(0.02)
        demo.send_signal(number)
        assert "interrupted" in demo.communicate(timeout=20)[1]
    assert demo.returncode == 130
    assert processes_of(endpoint) == []
