"""Ports for servers under test, which no other process takes meanwhile.

A port that the system chooses could be taken by any outgoing connection before the server listens
on it, or while the server restarts: even by a client that tries to reconnect to it, and so is
connected to itself. So ports are below those of outgoing connections. Each process of the tests,
and of any other run of them on this machine, has a block of its own as long as it lives, and hands
its ports out in turn.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import socket
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO

_FIRST = 10_000
_PER_BLOCK = 200
_BLOCKS = 100


def _own_block() -> tuple[range, IO[str]]:
    """A block of ports, and its file, whose lock holds it."""
    folder = Path(tempfile.gettempdir(), f"zenoh-tf-test-ports-{os.getuid()}")
    folder.mkdir(exist_ok=True)
    for number in range(_BLOCKS):
        file = (folder / str(number)).open("w")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            continue
        begin = _FIRST + number * _PER_BLOCK
        return range(begin, begin + _PER_BLOCK), file
    raise RuntimeError(f"{_BLOCKS} processes of tests are running: no ports are left")


def _ports() -> Iterator[int]:
    block, file = _own_block()
    with file:
        for port in itertools.cycle(block):
            with socket.socket() as probe, contextlib.suppress(OSError):
                probe.bind(("127.0.0.1", port))
                probe.close()
                yield port


_all = _ports()
_lock = threading.Lock()


def free_port() -> int:
    """A port of 127.0.0.1 that nothing listens on. Thread-safe."""
    with _lock:
        return next(_all)


def free_endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"
