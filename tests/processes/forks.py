"""Real Python processes that need not import the project first.

A new interpreter takes 0.25 to 0.45 s of processor time to import server, client and numpy, which
is more than most tests take. So each process of the tests has a fork server
(`fork_server`), which imports them once and forks for each start. The new process runs the
same program from its first line, with its own arguments, environment, streams and exit.

Tests of entry points, of what an import does and of how an interpreter ends use `subprocess`.

Thread safety: all functions and methods.
"""

from __future__ import annotations

import atexit
import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


class _ForkServer:
    """Ends with this process, and then kills what it has forked."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair()
        with theirs:
            # A fork of a process with threads is unsafe, and numpy's algebra would start some.
            environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.processes.fork_server", str(theirs.fileno())],
                cwd=ROOT,
                env=environment,
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )

    def fork(
        self, arguments: Sequence[str], cwd: str, environment: Mapping[str, str], files: list[int]
    ) -> int:
        """Run a program with `files` as its input, output and errors; return its process's id. Its
        wait status is written to the fourth file."""
        request = pickle.dumps((list(arguments), cwd, dict(environment)))
        with self._lock:
            socket.send_fds(self._socket, [len(request).to_bytes(8, "big")], files)
            self._socket.sendall(request)
            answer = self._socket.recv(8, socket.MSG_WAITALL)
        assert answer, "the fork server has ended"
        return int.from_bytes(answer, "big")

    def close(self) -> None:
        self._socket.close()
        self._process.wait()


def _interpreter_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """The variables that an interpreter and its allocator read when they start."""
    prefixes = ("PYTHON", "MALLOC")
    return {name: environment[name] for name in environment if name.startswith(prefixes)}


_INTERPRETER_VARIABLES = _interpreter_variables(os.environ)

_fork_server: _ForkServer | None = None
_fork_server_lock = threading.Lock()


def _running_fork_server() -> _ForkServer:
    global _fork_server  # noqa: PLW0603
    with _fork_server_lock:
        if _fork_server is None:
            _fork_server = _ForkServer()
            atexit.register(_fork_server.close)
        return _fork_server


class Popen(subprocess.Popen[str]):
    """As `subprocess.Popen` for text, of a command that begins with ``sys.executable``.

    The fork server is the process's parent, so the exit status comes through a pipe.
    """

    def __init__(self, command: Sequence[str | Path], **options: Any) -> None:
        assert command[0] == sys.executable
        assert not {"pass_fds", "preexec_fn", "start_new_session"} & options.keys()
        self._ended: int | None = None
        super().__init__([str(each) for each in command], **{"text": True} | options)

    def _execute_child(self, *arguments: Any) -> None:
        """Start it: the part of `subprocess.Popen` that differs between systems."""
        command, _, _, _, _, cwd, environment = arguments[:7]
        if environment is None:
            environment = os.environ
        has_options = command[1].startswith("-") and command[1] not in {"-m", "-c"}
        # `make coverage` measures interpreters from their start.
        measured = any(name.startswith("COVERAGE_PROCESS") for name in environment)
        if measured or has_options or _interpreter_variables(environment) != _INTERPRETER_VARIABLES:
            super()._execute_child(*arguments)  # type: ignore[misc]
            return
        stdin, _, _, stdout, _, stderr = arguments[10:16]
        streams = [n if own == -1 else own for n, own in enumerate((stdin, stdout, stderr))]
        self._ended, ended = os.pipe()
        try:
            self.pid = _running_fork_server().fork(
                command[1:],
                os.fspath(cwd or Path.cwd()),
                environment,
                [*streams, ended],
            )
        finally:
            os.close(ended)
            self._close_pipe_fds(*arguments[10:16])  # type: ignore[attr-defined]
        self._child_created = True

    def _internal_poll(self, *arguments: Any, **options: Any) -> Any:
        if self._ended is None:
            return super()._internal_poll(*arguments, **options)  # type: ignore[misc]
        return self._read_status(self._ended, 0.0)

    def _wait(self, timeout: float | None) -> Any:
        if self._ended is None:
            return super()._wait(timeout)  # type: ignore[misc]
        status = self._read_status(self._ended, timeout)
        if status is None:
            assert timeout is not None
            raise subprocess.TimeoutExpired(self.args, timeout)
        return status

    def _read_status(self, ended: int, timeout_s: float | None) -> int | None:
        """The exit status as in `returncode`, or None if it has not ended in time."""
        lock: threading.Lock = self._waitpid_lock  # type: ignore[attr-defined]
        if not lock.acquire(timeout=-1 if timeout_s is None else timeout_s):
            return self.returncode
        try:
            if self.returncode is None and select.select([ended], [], [], timeout_s)[0]:
                status = os.read(ended, 4)
                os.close(ended)
                killed = -signal.SIGKILL  # with the fork server
                self.returncode = int.from_bytes(status, "big", signed=True) if status else killed
            return self.returncode
        finally:
            lock.release()


def wait_until_stopped(pid: int) -> None:
    """Return when a signal has stopped all threads of a process, which may be another's child."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        while (task / "stat").read_text().rpartition(")")[2].split()[0] != "T":
            time.sleep(0.001)


def run(
    command: Sequence[str | Path],
    *,
    input: str | None = None,
    timeout: float = 50.0,
    check: bool = False,
    **options: Any,
) -> subprocess.CompletedProcess[str]:
    """As `subprocess.run` with ``capture_output``."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    if input is not None:
        options["stdin"] = subprocess.PIPE
    with Popen(command, **options) as process:
        try:
            out, err = process.communicate(input, timeout=timeout)
        except BaseException:
            process.kill()
            raise
    done = subprocess.CompletedProcess(process.args, process.returncode, out, err)
    if check:
        done.check_returncode()
    return done
