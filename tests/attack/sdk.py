"""``python sdk.py NAME ENDPOINT ...``: programs that use the SDK as a user would.

They use its public interface only, and nothing of the tests, so that they run with the SDK of
another checkout.
"""

from __future__ import annotations

import asyncio
import functools
import itertools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, NoReturn

from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf_client import AsyncTransformClient, TransformClient

client_of = functools.partial(TransformClient.connect, reads="query")


def announce_statics(endpoint: str) -> None:
    """A sensor's driver with two static links, which keeps running."""
    tf = client_of(endpoint)
    sensor = tf.broadcaster("driver")
    for child in ("camera", "lidar"):
        sensor.send_static(StampedTransform("root", child, 0, Transform((1, 0, 0))))
    while not tf.can_transform("root", "lidar"):
        time.sleep(0.01)
    print("announced", flush=True)
    time.sleep(600)


def set_behind_a_stall(endpoint: str) -> None:
    """Prints what the set raised, and the seconds from its expiry until it was seen to apply."""
    hasty = client_of(endpoint, timeout_s=0.5)
    watching = client_of(endpoint, timeout_s=20.0)
    print("ready", flush=True)
    sys.stdin.readline()
    time.sleep(0.2)
    outcome, late_s = "ok", 0.0
    for index in range(4):
        name = f"hasty {index}"
        try:
            hasty.set_transform(StampedTransform("root", name, 1, Transform()))
        except TransformException as error:
            outcome = type(error).__name__
            expiry_s = time.monotonic()
            if outcome != "OutcomeUnknown":
                continue
            if watching.can_transform("root", name):
                continue  # it ran in time, and only its reply was late
            deadline_s = expiry_s + 60.0
            while time.monotonic() < deadline_s:
                if watching.can_transform("root", name):
                    late_s = max(late_s, time.monotonic() - expiry_s)
                    break
                time.sleep(0.05)
    print(outcome, late_s, flush=True)


def call_after_fork(endpoint: str) -> None:
    """The child's line says what its call raised."""
    tf = client_of(endpoint)
    print("ready", flush=True)
    if os.fork() == 0:
        _report(tf.frames)
    os.wait()


def connect_after_fork(endpoint: str) -> None:
    tf = client_of(endpoint)
    print("ready", flush=True)
    if os.fork() == 0:
        _report(lambda: client_of(endpoint, timeout_s=5.0))
    os.wait()
    tf.close()


def _report(call: Callable[[], object]) -> None:
    signal.alarm(15)  # ends a child that hangs after its parent was killed
    try:
        call()
        print("works", flush=True)
    except BaseException as error:
        print(f"{type(error).__name__}: {error}", flush=True)
    os._exit(0)


def connect_to_nothing(endpoint: str, timeout_s: str) -> None:
    """Connect to an endpoint where nothing listens."""
    print("ready", flush=True)
    client_of("tcp/127.0.0.1:9", timeout_s=float(timeout_s))


def mirrors_again(endpoint: str) -> None:
    """Prints by how many MB twenty mirrors make this process grow after two rounds of them."""
    tf = client_of(endpoint)
    tf.set_transform(StampedTransform("root", "camera", 1, Transform()))

    def resident_mb() -> float:
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) / 256

    def mirrors() -> list[Any]:
        return [tf.mirror([("root", "camera")]) for _ in range(20)]

    before_mb = resident_mb()
    for _ in range(2):
        for mirror in mirrors():
            mirror.close()
    held = mirrors()
    print(resident_mb() - before_mb, flush=True)
    time.sleep(600)
    del held


def print_reads(endpoint: str) -> None:
    with TransformClient.connect(endpoint) as tf:
        print(tf.reads, flush=True)
        time.sleep(600)


# --- asyncio


async def _asyncio_client(endpoint: str) -> AsyncTransformClient:
    tf = await AsyncTransformClient.connect(endpoint, timeout_s=20.0, reads="query")
    await tf.set_transform(StampedTransform("a", "b", 1, Transform()))
    print("ready", flush=True)
    await asyncio.to_thread(sys.stdin.readline)
    return tf


def asyncio_flood(endpoint: str) -> None:
    """Calls without end, 5,000 at once."""

    async def main() -> None:
        tf = await _asyncio_client(endpoint)
        while True:
            calls = [tf.lookup_transform("a", "b") for _ in range(4900)]
            sets = [
                tf.set_transform(StampedTransform("a", f"flood {index}", 1, Transform()))
                for index in range(100)
            ]
            await asyncio.gather(*calls, *sets, return_exceptions=True)

    asyncio.run(main())


def asyncio_cancels(endpoint: str) -> None:
    """Calls without end that are cancelled at any point of their way."""

    async def main() -> None:
        tf = await _asyncio_client(endpoint)
        for turn in itertools.count():
            tasks = [
                asyncio.create_task(call)
                for index in range(100)
                for call in (
                    tf.lookup_transform("a", "b"),
                    tf.lookup_transform("a", "never", timeout_s=600.0),
                    tf.lookup_transform("a", "never", timeout_s=600.0),
                    tf.frames(),
                    tf.set_transform(StampedTransform("a", f"cancel {index}", 1, Transform())),
                )
            ]
            await asyncio.sleep(turn % 20 * 0.002)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    asyncio.run(main())


# --- programs whose exit status counts


def _end_beside(*targets: Callable[[], object], pause_s: float = 0.3) -> NoReturn:
    for target in targets:
        threading.Thread(target=target, daemon=True).start()
    print("ready", flush=True)
    time.sleep(pause_s)
    sys.exit(7)


def daemon_threads(endpoint: str) -> None:
    """Threads in calls while the program ends with a status of its own."""
    tf = client_of(endpoint)
    tf.set_transform(StampedTransform("a", "b", 1, Transform()))

    def forever() -> None:
        while True:
            tf.lookup_latest_transform("a", "b")

    _end_beside(*8 * [forever])


def daemon_waiters(endpoint: str) -> None:
    """The same with lookups that wait, and one that connects."""
    tf = client_of(endpoint)

    def wait() -> None:
        tf.lookup_transform("a", "never", timeout_s=100)

    def connect() -> None:
        while True:
            client_of(endpoint, timeout_s=2.0)

    _end_beside(wait, wait, wait, connect)


def daemon_batches(endpoint: str) -> None:
    """The same in large calls, which are in native code of several libraries."""
    tf = client_of(endpoint)
    tf.set_transform(StampedTransform("a", "b", 1, Transform()))
    stamps = [1] * 20_000

    def forever() -> None:
        while True:
            tf.lookup_transforms("a", "b", stamps)

    _end_beside(*6 * [forever], pause_s=0.5)


def unclosed_broadcasters(endpoint: str) -> None:
    tf = client_of(endpoint)
    for number in range(20):
        broadcaster = tf.broadcaster(f"driver {number}")
        broadcaster.send_static(StampedTransform("a", f"b {number}", 0, Transform()))
    print("ready", flush=True)
    sys.exit(7)


def publishing_thread(endpoint: str) -> None:
    tf = client_of(endpoint)
    sensor = tf.broadcaster("driver")

    def forever() -> None:
        while True:
            sensor.send(StampedTransform("a", "b", time.time_ns(), Transform()))

    _end_beside(forever)


if __name__ == "__main__":
    globals()[sys.argv[1]](*sys.argv[2:])
