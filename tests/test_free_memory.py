"""What large messages have used goes back to the system. Each test runs in a process of its own."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

# Small blocks that are freed, all but the last: without a request glibc keeps them.
SCRIPT = """
import ctypes, sys, time
from zenoh_tf_server.free_memory import FreeMemory, resident_bytes
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
memory = FreeMemory()
if {start}:
    memory.start()
time.sleep(0.5)  # it has seen the size
before = resident_bytes()
blocks = [libc.malloc(60_000) for _ in range(2500)]
for block in blocks:
    ctypes.memset(block, 1, 60_000)
grown = resident_bytes() - before
last = blocks.pop()
for block in blocks:
    libc.free(ctypes.c_void_p(block))
end = time.monotonic() + ({seconds})
while resident_bytes() - before > 20e6 and time.monotonic() < end:
    time.sleep(0.05)
print(grown, resident_bytes() - before)
memory.close()
"""


def _kept(start: bool, seconds: float) -> int:
    command = [sys.executable, "-c", SCRIPT.format(start=start, seconds=seconds)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    grown, kept = map(int, done.stdout.split())
    assert grown > 140e6
    return kept


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="needs glibc")
def test_freed_memory_goes_back() -> None:
    assert _kept(start=False, seconds=3.0) > 100e6  # otherwise this tests nothing
    assert _kept(start=True, seconds=30.0) < 20e6
