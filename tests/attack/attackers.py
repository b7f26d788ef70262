"""``python -m tests.attack.attackers KIND ENDPOINT ...``: hostile or greedy clients.

Each prints "ready", waits for a line on stdin, and continues until it is killed.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import mmap
import os
import signal
import socket
import sys
import time

import numpy as np
import zenoh

from tests.support import messages
from zenoh_tf._net import handover, keys


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


def _offer(opened: zenoh.Session) -> tuple[handover.Offer, str]:
    """Where the server hands its tree over, and its instance."""
    hello = messages.value(opened, "hello", "hello")
    offer = handover.parse_offer(hello["share"])
    assert offer is not None
    return offer, hello["instance"]


def region(opened: zenoh.Session) -> None:
    """Take memory through the descriptor of the shared tree, up to 1 GB each way."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as peer:
        peer.connect(_offer(opened)[0].socket)
        _, [fd], _, _ = socket.recv_fds(peer, 1, 1)
    if os.geteuid() == 0:
        os.setuid(65534)  # a member of the group that may read, and no more
    ready()

    def taken_mb() -> float:
        return os.fstat(fd).st_blocks / 2048

    before_mb = taken_mb()
    size = min(os.fstat(fd).st_size, 1 << 30)
    with mmap.mmap(fd, size, mmap.MAP_SHARED, mmap.PROT_READ) as mapped:
        for page in range(0, size, mmap.PAGESIZE):
            mapped[page]
    read_mb = taken_mb()
    refused: str | None = "allowed"
    with contextlib.suppress(OSError):  # another descriptor of the same file
        fd = os.open(f"/proc/self/fd/{fd}", os.O_RDWR)
    try:
        os.posix_fallocate(fd, 0, size + (256 << 20))
    except OSError as error:
        refused = error.strerror
    found = {
        "reading_mb": read_mb - before_mb,
        "fallocate_mb": taken_mb() - read_mb,
        "refused": refused,
    }
    print(json.dumps(found), flush=True)
    time.sleep(600)


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


def waiters(opened: zenoh.Session, rows: str, timeout_s: str) -> None:
    """One message that waits with many rows; says when it was refused."""
    body = messages.same_lookup(int(rows), "probe_map", "probe_never")
    body["timeout_ns"] = int(float(timeout_s) * 1e9)
    ready()
    held = messages.ask(opened, "lookup", messages.pack(body), min(float(timeout_s), 3600.0))
    print("asked", flush=True)
    for reply in held:
        print(messages.kind_of(reply.err.payload.to_bytes() if reply.err else b"", True))
    time.sleep(600)


def known_waiters(opened: zenoh.Session, queries: str, timeout_s: str) -> None:
    """Queries that wait, of a client with a token, which keeps asking until it is killed."""
    _ = opened.liveliness().declare_token(keys.client(messages.TREE, str(opened.zid())))
    messages.send(opened, "info", {"v": 1, "what": "hello"})
    body = messages.same_lookup(1, "probe_map", "probe_never")
    body["timeout_ns"] = int(float(timeout_s) * 1e9)
    payload = messages.pack(body)
    ready()
    held = [messages.ask(opened, "lookup", payload, 3600.0) for _ in range(int(queries))]
    print("asked", flush=True)
    while True:  # so that some are under way when it is killed
        held.append(messages.ask(opened, "lookup", payload, 3600.0))
        time.sleep(0.001)
        del held[1000:]


def main() -> None:
    kind, endpoint, *arguments = sys.argv[1:]
    busy = (frozen, lookups, remembered, puts, liar, region)
    kinds = (*busy, waiters, known_waiters)
    play = {each.__name__: each for each in kinds}[kind]
    with messages.session(endpoint) as opened:
        play(opened, *arguments)


if __name__ == "__main__":
    main()
