"""Helpers of the image test: expect a fact, wait for one, report one."""

from __future__ import annotations

import time
from collections.abc import Callable


def expect(fact: bool, otherwise: str) -> None:
    """Fail the test unless ``fact`` is true."""
    if not fact:
        raise SystemExit(f"image test failed: {otherwise}")


def until(condition: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
    """Wait for a condition; fail the test if it does not become true in time."""
    end = time.monotonic() + timeout_s
    while not condition():
        expect(time.monotonic() < end, f"{otherwise} (waited {timeout_s:.0f} s)")
        time.sleep(0.05)


def say(subject: str, fact: str) -> None:
    """Print one line of the test's report."""
    print(f"{subject:>15}  {fact}", flush=True)
