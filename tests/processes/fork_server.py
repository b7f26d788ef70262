"""The process that forks for `forks`: ``python -m tests.processes.fork_server SOCKET``.

It has one thread, so what it forks inherits no lock that another thread holds.
"""

from __future__ import annotations

import gc
import os
import pickle
import runpy
import select
import signal
import socket
import sys
import types
from dataclasses import dataclass
from pathlib import Path

import zenoh_tf_server.main  # noqa: F401
import zenoh_tf_tools.cli.main  # noqa: F401

#: Standard input, output and errors, and where the wait status goes.
_FILES = 4


@dataclass(frozen=True)
class Program:
    """What a new process runs."""

    arguments: list[str]
    cwd: str
    environment: dict[str, str]
    files: list[int]


def serve(requests: socket.socket) -> Program | None:
    """Fork for each request until the other end closes: then None. Returns in each new process,
    with its program."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the tests and what they start
    signal.signal(signal.SIGCHLD, lambda *_: None)
    wakeups, wakeup = socket.socketpair()
    for end in (wakeups, wakeup):
        end.setblocking(False)
    signal.set_wakeup_fd(wakeup.fileno())
    running: dict[int, int] = {}
    while True:
        ready = select.select([requests, wakeups], [], [])[0]
        if wakeups in ready:
            wakeups.recv(4096)
            _report_ended(running)
        if requests not in ready:
            continue
        program = _receive(requests)
        if program is None:
            for pid in running:
                os.kill(pid, signal.SIGKILL)
            return None
        pid = os.fork()
        if pid == 0:
            signal.set_wakeup_fd(-1)
            for end in (requests, wakeups, wakeup):
                end.close()
            for report in running.values():
                os.close(report)
            return program
        running[pid] = program.files.pop()
        for file in program.files:
            os.close(file)
        requests.sendall(pid.to_bytes(8, "big"))


def _receive(requests: socket.socket) -> Program | None:
    length, files, _, _ = socket.recv_fds(requests, 8, _FILES)
    if not length:
        return None
    data = requests.recv(int.from_bytes(length, "big"), socket.MSG_WAITALL)
    arguments, cwd, environment = pickle.loads(data)
    return Program(arguments, cwd, environment, files)


def _report_ended(running: dict[int, int]) -> None:
    for pid in list(running):
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            report = running.pop(pid)
            os.write(report, os.waitstatus_to_exitcode(status).to_bytes(4, "big", signed=True))
            os.close(report)


def become(program: Program) -> None:
    """Take over the program's signals, files, folder and environment."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number, file in enumerate(program.files[:3]):
        os.dup2(file, number)
    for file in program.files:
        os.close(file)
    at_once = "PYTHONUNBUFFERED" in program.environment
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stdout.reconfigure(write_through=at_once)
    sys.stderr = open(2, "w", errors="backslashreplace", closefd=False)  # noqa: SIM115
    sys.stderr.reconfigure(line_buffering=True)
    os.chdir(program.cwd)
    os.environ.clear()
    os.environ.update(program.environment)


def run(arguments: list[str], cwd: str) -> None:
    """Run what ``python ARGUMENTS`` would run."""
    what = arguments[0]
    if what == "-m":
        sys.path[0] = cwd
        sys.argv = arguments[1:]
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
    elif what == "-c":
        sys.path[0] = ""
        sys.argv = ["-c", *arguments[2:]]
        main = sys.modules["__main__"] = types.ModuleType("__main__")
        exec(compile(arguments[1], "<string>", "exec"), main.__dict__)
    else:
        sys.path[0] = str(Path(what).parent)
        sys.argv = arguments
        runpy.run_path(what, run_name="__main__")


def main() -> None:
    gc.freeze()  # so that no collection in a new process copies their memory
    program = serve(socket.socket(fileno=int(sys.argv[1])))
    if program is not None:
        become(program)
        run(program.arguments, program.cwd)


if __name__ == "__main__":
    main()
