"""What a server costs its host: memory and processor time, for docs/deploy.md.

    python -m bench.sizing

Starts servers and publishers on this machine. Processor time is that of the server's process, so
that other load matters little; memory is its resident set. Takes about two minutes.
"""

from __future__ import annotations

import gc
import multiprocessing
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zenoh

from zenoh_tf import keys, wire, zenoh_config
from zenoh_tf_client import TransformClient

from . import machine

FRAMES_PER_SENSOR = 10
SENSORS_PER_ROBOT = 6
RATE_HZ = 100
#: Long enough for full histories, and then for the measurement.
FILL_S, MEASURE_S = 11.0, 6.0
CONNECTIONS = 40
WAITING = 2000
LOOKUPS = 2000


@dataclass(frozen=True)
class Usage:
    resident_bytes: int
    processor_s: float


class ServerProcess:
    """A server with the defaults, and what it uses."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "zenoh_tf_server", "--listen", self.endpoint],
            stdout=subprocess.PIPE,
        )
        assert self.process.stdout is not None
        self.process.stdout.readline()

    def usage(self) -> Usage:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        resident = re.search(r"VmRSS:\s+(\d+) kB", status)
        assert resident is not None
        return Usage(int(resident[1]) * 1024, machine.cpu_s(self.process.pid))

    def close(self) -> None:
        self.process.terminate()
        self.process.communicate(timeout=20)


@contextmanager
def running() -> Iterator[ServerProcess]:
    server = ServerProcess()
    try:
        yield server
    finally:
        server.close()


def publish(endpoint: str, robots: range, seconds: float) -> None:
    """Publish as the sensors of some robots, in their pace; late messages are sent at once."""
    rows = FRAMES_PER_SENSOR
    with zenoh.open(zenoh_config.client([endpoint], 10.0)) as session:
        sensors = []
        for robot in robots:
            for sensor in range(SENSORS_PER_ROBOT):
                name = f"robot{robot}/sensor{sensor}"
                names = [f"robot{robot}", *(f"{name}/{row}" for row in range(rows))]
                key = keys.put("main", name, static=False)
                sensors.append((session.declare_publisher(key), names))
        poses = np.tile([0.0, 0, 0, 0, 0, 0, 1], (rows, 1))
        begun_s = time.monotonic()
        for tick in range(round(seconds * RATE_HZ)):
            stamps = np.full(rows, time.time_ns())
            for publisher, names in sensors:
                commit = wire.Commit(
                    names,
                    np.zeros(rows, np.uint32),
                    np.arange(1, rows + 1, dtype=np.uint32),
                    stamps,
                    poses,
                )
                publisher.put(wire.pack(wire.commit_body(commit, {})))
            time.sleep(max(0.0, begun_s + tick / RATE_HZ - time.monotonic()))


def measure_robots(robots: int) -> None:
    with (
        running() as server,
        TransformClient.connect(server.endpoint, timeout_s=20.0, reads="query") as tf,
    ):
        before = server.usage()
        count = min(robots, 2)
        spawn = multiprocessing.get_context("spawn")
        publishers = [
            spawn.Process(
                target=publish,
                args=(server.endpoint, range(part, robots, count), FILL_S + MEASURE_S + 5),
            )
            for part in range(count)
        ]
        for publisher in publishers:
            publisher.start()
        time.sleep(FILL_S + 4)
        first, puts, begun_s = server.usage(), tf.stats()["puts"], time.monotonic()
        time.sleep(MEASURE_S)
        last, stats, ended_s = server.usage(), tf.stats(), time.monotonic()
        for publisher in publishers:
            publisher.terminate()
            publisher.join()
    processor_s = last.processor_s - first.processor_s
    messages = stats["puts"] - puts
    share = processor_s / messages * robots * SENSORS_PER_ROBOT * RATE_HZ
    print(
        f"{robots:3} robots: {last.resident_bytes / 1e6:6.0f} MB resident, "
        f"{before.resident_bytes / 1e6:.0f} MB before; {stats['samples']:,} samples; "
        f"{processor_s / messages * 1e6:.0f} us of processor per message, "
        f"{100 * share:.0f} % of a core at {RATE_HZ} Hz; "
        f"came at {messages / (ended_s - begun_s) / robots / SENSORS_PER_ROBOT:.0f} Hz"
    )


def measure_clients() -> None:
    with running() as server, ExitStack() as stack:
        stack.enter_context(TransformClient.connect(server.endpoint, timeout_s=20.0, reads="query"))
        time.sleep(1)
        before = server.usage()
        for _ in range(CONNECTIONS):
            stack.enter_context(
                TransformClient.connect(server.endpoint, timeout_s=20.0, reads="query")
            )
        time.sleep(3)
        after = server.usage()
        each = (after.resident_bytes - before.resident_bytes) / CONNECTIONS
        time.sleep(10)
        idle = (server.usage().processor_s - after.processor_s) / 10 / CONNECTIONS
        print(f"connection: {each / 1e3:.0f} kB, {100 * idle:.3f} % of a core while idle")


def measure_lookups() -> None:
    with (
        running() as server,
        TransformClient.connect(server.endpoint, timeout_s=20.0, reads="query") as tf,
    ):
        session = zenoh.open(zenoh_config.client([server.endpoint], 10.0))
        time.sleep(1)
        before = server.usage()
        held = [
            session.get(
                keys.operation("main", "lookup"),
                payload=wire.pack(
                    {
                        **wire.one_read("map", f"f{row}", wire.OP_COMMON, wire.NO_STAMP),
                        "timeout_ns": 60 * 10**9,
                    }
                ),
                timeout=60.0,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
            for row in range(WAITING)
        ]
        while tf.stats()["waiters"] < WAITING:
            time.sleep(0.05)
        after = server.usage()
        each = (after.resident_bytes - before.resident_bytes) / WAITING
        print(f"waiting lookup: {each / 1e3:.1f} kB")
        del held
        gc.collect()
        begun = server.usage()
        for _ in range(LOOKUPS):
            tf.can_transform("map", "map")
        spent_s = server.usage().processor_s - begun.processor_s
        print(f"single lookup: {spent_s / LOOKUPS * 1e6:.0f} us of processor")
        session.close()


def main() -> None:
    """Measure and print."""
    for key, value in machine.describe().items():
        print(f"{key}: {value}")
    for robots in (1, 10):
        measure_robots(robots)
    measure_clients()
    measure_lookups()


if __name__ == "__main__":
    main()
