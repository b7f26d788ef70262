"""Attacks 16 to 19, 23 and 24: what readers, robots and other users of the host take or replace."""

from __future__ import annotations

import contextlib
import json
import math
import os
import socket
import stat
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import zenoh

from tests.processes.ports import free_endpoint
from tests.support import messages

from .arena import Arena, Finding, beside, case
from .processes import HERE, Process, Server, attacker, first_line

_ROBOT_FRAMES = 10_000
_COPY_TIMEOUT_S = 60.0


def _wait_for(opened: zenoh.Session, counter: str, least: float, timeout_s: float) -> float:
    """Seconds until a counter of `stats` has reached a value; infinity if it does not in time."""
    start_s = time.monotonic()
    while time.monotonic() - start_s < timeout_s:
        if messages.stats(opened)[counter] >= least:
            return time.monotonic() - start_s
        time.sleep(0.1)
    return math.inf


@contextlib.contextmanager
def _robot(arena: Arena, frames: int) -> Iterator[Server]:
    with arena.opened() as (robot, opened):
        messages.send(opened, "commit", messages.star("part_", 0, frames))
        yield robot


@case("16: a site takes the first copy of a robot with 10,000 frames, beside lookups at the site")
def first_copy_of_a_robot(arena: Arena) -> list[Finding]:
    endpoint = free_endpoint()
    took_s = math.inf
    with tempfile.TemporaryDirectory() as folder:
        state = ("--state-dir", str(Path(folder, "state")))
        with arena.opened(*state) as (_, opened):
            body = messages.star("part_", 0, _ROBOT_FRAMES, static=True)
            messages.send(opened, "commit", body)
        with arena.server("--mirror-of", f"robot1={endpoint}") as site:

            def attack() -> None:
                nonlocal took_s
                # It has its frames before anyone can reach it, so all of them are in the copy.
                with (
                    arena.server(*state, endpoint=endpoint),
                    messages.session(site.endpoint) as opened,
                ):
                    counter = "robot_stored/robot1"
                    took_s = _wait_for(opened, counter, _ROBOT_FRAMES, _COPY_TIMEOUT_S)

            found = beside(site, ["lookup"], attack, 4.0)
    return [Finding("first copy", took_s, "s", 10.0), *found.outages(), found.p99("lookup")]


@case("17: a process that may read the tree's memory allocates all of it")
def memory_taken_by_a_reader(arena: Arena) -> list[Finding]:
    with (
        tempfile.TemporaryDirectory() as folder,
        arena.server(
            "--share-dir", folder, "--limit", "frames=10000", "--max-memory", "512M"
        ) as server,
        attacker(server.endpoint, "region") as reader,
    ):
        reader.go()
        found = json.loads(first_line(reader.stdout, 60.0))
    return [
        Finding("taken by fallocate", found["fallocate_mb"], "MB", 0, found["refused"]),
        Finding("taken by reading", found["reading_mb"], "MB", 8.0, "10,000 frames are 2.4 MB"),
    ]


@case("18: a client opens 20 mirrors of a pair, closes them, twice, and opens 20 again")
def mirrors_opened_again(arena: Arena) -> list[Finding]:
    with arena.server() as server:
        command = [server.python, str(HERE / "sdk.py"), "mirrors_again", server.endpoint]
        with Process(command, subprocess.DEVNULL) as script:
            grown_mb = float(script.greeting)
    return [Finding("memory of 20 mirrors", grown_mb, "MB", 60.0)]


@case("19: a robot has 3,000 frames, and the site has room for 2,000")
def greedy_robot(arena: Arena) -> list[Finding]:
    with _robot(arena, 3000) as greedy, _robot(arena, 20) as modest:
        links = ["--mirror-of", f"greedy={greedy.endpoint}"]
        links += ["--mirror-of", f"modest={modest.endpoint}"]
        with arena.opened("--limit", "frames=2000", *links) as (site, opened):
            _wait_for(opened, "robot_refused/greedy", 1, 20.0)
            _wait_for(opened, "robot_stored/modest", 20, 5.0)
            body = messages.star("of the site", 0, 100)
            reply, failed = messages.send(opened, "commit", body)
            stats = messages.stats(opened)
            reported = b"greedy" in site.log and b"LimitExceeded" in site.log
    missing = 20 - stats["robot_stored/modest"]
    return [
        Finding("frames of the next robot missing", missing, "", 0),
        Finding("the site's own write fails", failed, "", 0, messages.kind_of(reply, failed)),
        Finding("not reported by name", not reported, "", 0),
    ]


@case("23: the socket's folder is open to all users, at the server's start and later")
def socket_of_another_user(arena: Arena) -> list[Finding]:
    accepted = True
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o777)
        try:
            with arena.server("--share-dir", folder):
                pass
        except RuntimeError:  # did not start
            accepted = False
        os.chmod(folder, 0o700)
        with arena.server("--share-dir", folder) as server:
            os.chmod(folder, 0o777)
            command = [server.python, str(HERE / "sdk.py"), "print_reads", server.endpoint]
            with Process(command, subprocess.DEVNULL) as script:
                reads = script.greeting
    return [
        Finding("accepted by the server", accepted, "", 0),
        Finding("accepted by a client", reads != "query", "", 0, reads),
    ]


@case("24: who may read the state, whose sockets are removed, and a limit in the config file")
def files_of_the_server(arena: Arena) -> list[Finding]:
    with tempfile.TemporaryDirectory() as folder:
        state, sockets, config = Path(folder, "state"), Path(folder, "run"), Path(folder, "c.toml")
        sockets.mkdir(mode=0o700)
        config.write_text('max-memory = "1G"\n[limits]\nframes = 5000\n')
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(sockets / "another.sock"))
        flags = ("--state-dir", str(state), "--share-dir", str(sockets))
        with arena.server(*flags):
            mode = stat.S_IMODE((state / "state.sqlite3").stat().st_mode)
            removed = not (sockets / "another.sock").exists()
        refused = False
        try:
            with arena.server("--config", str(config)):
                pass
        except RuntimeError:
            refused = True
    return [
        Finding("others may read the state", mode & 0o077 != 0, "", 0, f"{mode:04o}"),
        Finding("another program's socket removed", removed, "", 0),
        Finding("a unit in the file refused", refused, "", 0),
    ]
