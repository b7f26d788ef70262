"""Attack 8: the exit status of servers and of programs that use the SDK."""

from __future__ import annotations

import os
import signal
import subprocess
import time

from . import messages
from .arena import Arena, attackers
from .processes import HERE, Process
from .results import Finding

_RUNS = int(os.environ.get("EXITS", "50"))
_STATUS = 7  # with which the programs of sdk.py end
_STOP_S = 2.0


def server_with_puts_in_flight(arena: Arena) -> list[Finding]:
    """8: SIGTERM to a server with large puts in flight"""
    return _stop_server(arena, [("puts", "100000", f"p{index}") for index in range(2)])


def server_with_lookups_in_flight(arena: Arena) -> list[Finding]:
    """8b: SIGTERM to a server with large lookups in flight"""
    return _stop_server(arena, [("lookups", "50000", "probe_base")] * 2)


def _stop_server(arena: Arena, each: list[tuple[str, ...]]) -> list[Finding]:
    abnormal, statuses, worst_s = 0, set(), 0.0
    for run in range(_RUNS):
        with arena.server() as server, attackers(server, *each) as begin:
            begin()
            time.sleep(0.3 + 0.01 * run)
            status, took_s = server.terminate()
            statuses.add(status)
            abnormal += status != 0
            worst_s = max(worst_s, took_s)
    return [
        Finding("abnormal ends", abnormal, f"of {_RUNS}", 0, f"statuses {sorted(statuses)}"),
        Finding("SIGTERM at worst", worst_s, "s", _STOP_S),
    ]


def daemon_threads(arena: Arena) -> list[Finding]:
    """8c: a program ends with status 7 while daemon threads are in lookups"""
    return _end_program(arena, "daemon_threads")


def daemon_waiters(arena: Arena) -> list[Finding]:
    """8d: the same in lookups that wait, and in connect"""
    return _end_program(arena, "daemon_waiters")


def unclosed_broadcasters(arena: Arena) -> list[Finding]:
    """8e: the same with broadcasters of statics that are not closed"""
    return _end_program(arena, "unclosed_broadcasters")


def publishing_thread(arena: Arena) -> list[Finding]:
    """8f: the same with a thread that publishes"""
    return _end_program(arena, "publishing_thread")


def daemon_batches(arena: Arena) -> list[Finding]:
    """8g: the same in large lookups"""
    return _end_program(arena, "daemon_batches")


def frozen_server(arena: Arena) -> list[Finding]:
    """8h: the same in lookups of a server that is stopped"""
    return _end_program(arena, "daemon_threads", freeze=True)


def _end_program(arena: Arena, name: str, *, freeze: bool = False) -> list[Finding]:
    abnormal, statuses = 0, set()
    with arena.server() as server, messages.session(server.endpoint):
        for _ in range(_RUNS):
            command = [server.python, str(HERE / "sdk.py"), name, server.endpoint]
            with Process(command, subprocess.DEVNULL) as program:
                if freeze:
                    server.signal(signal.SIGSTOP)
                try:
                    status = program.process.wait(30.0)
                except subprocess.TimeoutExpired:
                    status = -signal.SIGALRM
            server.signal(signal.SIGCONT)
            statuses.add(status)
            abnormal += status != _STATUS
    note = f"statuses {sorted(statuses)}"
    return [Finding("abnormal ends", abnormal, f"of {_RUNS}", 0, note)]
