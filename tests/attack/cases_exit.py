"""Attack 8: the exit status of servers and of programs that use the SDK."""

from __future__ import annotations

import os
import signal
import subprocess
import time

from tests.support import messages

from .arena import Arena, Finding, attackers, case
from .processes import HERE, Process

_RUNS = int(os.environ.get("EXITS", "50"))
_STATUS = 7  # with which the programs of sdk.py end
_STOP_S = 2.0


@case(
    "8: SIGTERM to a server with large puts in flight",
    *[("puts", "100000", f"p{index}") for index in range(2)],
)
@case(
    "8b: SIGTERM to a server with large lookups in flight",
    ("lookups", "50000", "probe_base"),
    ("lookups", "50000", "probe_base"),
)
def _stop_server(arena: Arena, *each: tuple[str, ...]) -> list[Finding]:
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


@case("8c: a program ends with status 7 while daemon threads are in lookups", "daemon_threads")
@case("8d: the same in lookups that wait, and in connect", "daemon_waiters")
@case("8e: the same with broadcasters of statics that are not closed", "unclosed_broadcasters")
@case("8f: the same with a thread that publishes", "publishing_thread")
@case("8g: the same in large lookups", "daemon_batches")
@case("8h: the same in lookups of a server that is stopped", "daemon_threads", freeze=True)
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
