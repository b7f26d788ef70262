"""The router keeps nothing of publishers that are gone, and everything of those that are not."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest
import zenoh

from tests.processes import forks
from tests.processes.ports import free_endpoint
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf._zenoh.abandoned_keys import AbandonedKeys

COUNT = 1000
#: A publisher of each name, in a process that is then killed.
PUBLISH = """
import sys, zenoh
from zenoh_tf._net import keys, zenoh_config
session = zenoh.open(zenoh_config.client([sys.argv[1]], 10.0))
publishers = []
for number in range(int(sys.argv[2])):
    for static in (False, True):
        key = keys.put("main", f"sensor {number}", static=static)
        publishers.append(session.declare_publisher(key))
list(session.get("ready"))  # a reply comes after all that was sent
print("ready", flush=True)
sys.stdin.read()
"""


class _Info(ctypes.Structure):
    """glibc's mallinfo2."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def used_bytes() -> int:
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "mallinfo2"):
        pytest.skip("needs glibc 2.33, which reports the memory in use")
    libc.mallinfo2.restype = _Info
    info = libc.mallinfo2()
    return int(info.uordblks + info.hblkhd)


@pytest.fixture
def router() -> Iterator[tuple[str, zenoh.Session]]:
    endpoint = free_endpoint()
    with zenoh.open(zenoh_config.router([endpoint])) as session:
        session.declare_queryable("ready", lambda query: query.reply("ready", b""))
        yield endpoint, session


def publish_and_die(endpoint: str, session: zenoh.Session) -> None:
    command = [sys.executable, "-c", PUBLISH, endpoint, str(COUNT)]
    with forks.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.kill()
    while list(session.info.transports()):
        time.sleep(0.01)


def test_the_keys_of_killed_publishers_are_freed(router: tuple[str, zenoh.Session]) -> None:
    names = [f"sensor {number}" for number in range(COUNT)]
    before = used_bytes()
    publish_and_die(*router)
    kept = used_bytes() - before
    AbandonedKeys(router[1], "main", lambda: names).free()
    left = used_bytes() - before
    assert kept > 2 * COUNT * 600, "Zenoh frees them by itself: AbandonedKeys can go"
    assert left < kept / 4


def test_a_publisher_that_lives_goes_on(router: tuple[str, zenoh.Session]) -> None:
    endpoint, session = router
    received: list[bytes] = []
    session.declare_subscriber(
        keys.all_puts("main"), lambda sample: received.append(sample.payload.to_bytes())
    )
    with zenoh.open(zenoh_config.client([endpoint], 10.0)) as client:
        publisher = client.declare_publisher(
            keys.put("main", "wheels", static=False),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        for number in range(100):
            publisher.put(str(number).encode())
            AbandonedKeys(session, "main", lambda: ["wheels"]).free()
        end_s = time.monotonic() + 10.0
        while len(received) < 100 and time.monotonic() < end_s:
            time.sleep(0.01)
    assert received == [str(number).encode() for number in range(100)]
