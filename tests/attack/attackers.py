"""``python -m tests.attack.attackers KIND ENDPOINT ...``: hostile or greedy clients.

Each prints "ready", waits for a line on stdin, and continues until it is killed.
"""

from __future__ import annotations

import itertools
import os
import signal
import sys
import time

import numpy as np
import zenoh

from tests.support import messages
from zenoh_tf._net import keys


def ready() -> None:
    print("ready", flush=True)
    sys.stdin.readline()


def frozen(opened: zenoh.Session, queries: str, rows: str) -> None:
    """Ask for replies and stop, as a program under a debugger or a laptop that sleeps."""
    payload = messages.pack(messages.same_lookup(int(rows), "probe_map", "probe_base"))
    ready()
    held = [messages.ask(opened, "lookup", payload) for _ in range(int(queries))]
    time.sleep(0.02)  # sends what is queued
    os.kill(os.getpid(), signal.SIGSTOP)
    time.sleep(600)
    del held


def lookups(opened: zenoh.Session, rows: str, source: str) -> None:
    """Batch after batch of lookups; they fail if `source` is unknown."""
    payload = messages.pack(messages.same_lookup(int(rows), "probe_map", source))
    ready()
    while True:
        messages.send(opened, "lookup", payload)


def remembered(opened: zenoh.Session, rows: str) -> None:
    """Batches of lookups and one set, whose replies the server has to remember."""
    reads = messages.same_lookup(int(rows), "probe_map", "probe_base")
    operations = [["lookup", reads], ["commit", messages.star("greedy", 0, 1)]]
    ready()
    while True:
        body = {"v": 1, "operations": operations, **messages.write_fields(opened)}
        messages.send(opened, "batch", body)


def puts(opened: zenoh.Session, rows: str, authority: str) -> None:
    """A flood of puts; each is newer than the last."""
    publisher = opened.declare_publisher(
        keys.put(messages.TREE, authority, static=False),
        congestion_control=zenoh.CongestionControl.BLOCK,
    )
    body = messages.star(f"{authority}_", 0, int(rows))
    ready()
    while True:
        body["stamp"] = np.full(int(rows), time.time_ns(), "<i8").tobytes()
        publisher.put(messages.pack(body))


def liar(opened: zenoh.Session, endpoint: str) -> None:
    """A robot that sends 333,000 transforms a second and restarts every second. After each restart
    it has another name and other frames; some puts are in a sensor's name."""
    rows, rate_hz = 333, 1000
    opened.close()
    ready()
    for life in itertools.count():
        body = messages.star(f"liar{life}_", 0, rows)
        with messages.session(endpoint) as robot:
            begin_s = time.monotonic()
            for put in range(rate_hz):
                name = "probe_sensor" if put % 10 == 0 else f"liar{life}"
                body["stamp"] = np.full(rows, time.time_ns(), "<i8").tobytes()
                robot.put(keys.put(messages.TREE, name, static=False), messages.pack(body))
                time.sleep(max(0.0, begin_s + put / rate_hz - time.monotonic()))


def main() -> None:
    kind, endpoint, *arguments = sys.argv[1:]
    kinds = (frozen, lookups, remembered, puts, liar)
    play = {each.__name__: each for each in kinds}[kind]
    with messages.session(endpoint) as opened:
        play(opened, *arguments)


if __name__ == "__main__":
    main()
