"""Freed memory is little, and goes back to the system. Each test runs in a process of its own."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys

import pytest

# Small blocks that are freed, all but the last: without a request glibc keeps them.
SCRIPT = """
import ctypes, sys, time
from zenoh_tf.mirrors.free_memory import FreeMemory, resident_bytes
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
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=150)
    grown, kept = map(int, done.stdout.split())
    assert grown > 140e6
    return kept


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="needs glibc")
def test_freed_memory_goes_back() -> None:
    assert _kept(start=False, seconds=1.0) > 100e6  # otherwise this tests nothing
    assert _kept(start=True, seconds=30.0) < 20e6


# As a crowd of connections leaves it.
NO_FREE_FILE = """
import logging, resource, threading, time
from zenoh_tf.mirrors import free_memory
seen = []
logging.getLogger("zenoh_tf").addHandler(handler := logging.Handler())
handler.emit = seen.append
free_memory._INTERVAL_S = 0.01
looked = threading.Semaphore(0)
free_memory.resident_bytes = lambda look=free_memory.resident_bytes: looked.release() or look()
memory = free_memory.FreeMemory()
memory.start()
resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))
print(all(looked.acquire(timeout=10) for _ in range(10)), seen)
"""


def test_a_size_that_cannot_be_read_is_read_later() -> None:
    done = subprocess.run(
        [sys.executable, "-c", NO_FREE_FILE], check=True, capture_output=True, text=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("True []\n", "")


# Threads that allocate at the same time, so that each would get a heap of its own.
HEAPS = """
import ctypes, sys, threading
from zenoh_tf.mirrors.free_memory import set_up_heaps
if {limit}:
    set_up_heaps()
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
started = threading.Barrier(32)
def allocate():
    for _ in range(1000):
        libc.malloc(2000)
    started.wait()
threads = [threading.Thread(target=allocate) for _ in range(32)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
libc.malloc_info(0, ctypes.c_void_p.in_dll(libc, "stdout"))
libc.fflush(None)
"""


def _heaps(*, limit: bool) -> int:
    environment = {name: value for name, value in os.environ.items() if "MALLOC" not in name}
    command = [sys.executable, "-c", HEAPS.format(limit=limit)]
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, timeout=150, env=environment
    )
    return done.stdout.count("<heap nr=")


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="needs glibc")
def test_threads_share_few_heaps() -> None:
    assert _heaps(limit=False) > 4  # otherwise this tests nothing
    assert _heaps(limit=True) <= 4


# Requests of 800 kB, one after the other. Several copies of a reply are alive at a time.
LONG_REQUESTS = """
import resource, threading
from zenoh_tf.mirrors.free_memory import set_up_heaps
if {set_up}:
    set_up_heaps()
def serve():
    for _ in range(300):
        request = bytes(800_000)
        parts = [bytes(100_000) for _ in range(8)]
        reply = b"".join(parts)
        copies = [bytearray(reply) for _ in range(2)]
def run():
    thread = threading.Thread(target=serve)
    thread.start()
    thread.join()
run()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
run()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def _page_faults(*, set_up: bool) -> int:
    environment = {name: value for name, value in os.environ.items() if "MALLOC" not in name}
    command = [sys.executable, "-c", LONG_REQUESTS.format(set_up=set_up)]
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, timeout=150, env=environment
    )
    return int(done.stdout)


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="needs glibc")
def test_long_requests_use_the_same_pages_again() -> None:
    assert _page_faults(set_up=False) > 20_000  # otherwise this tests nothing
    assert _page_faults(set_up=True) < 2_000
