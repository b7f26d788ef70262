"""The processes of an attack: a server, probes beside it, attackers and plain processor load.

Server and probes run under an interpreter of the caller's choice, so that the code of another
checkout can be attacked with the same tool. The attackers run under this tool's own.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

from tests.processes.ports import free_endpoint
from tests.processes.server_costs import cpu_s, status_mb

if TYPE_CHECKING:
    from typing_extensions import Self

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
#: Python would prefer the packages of the folder that it is started in.
ELSEWHERE = Path(tempfile.gettempdir())
START_TIMEOUT_S = 60.0
#: A server that would take more than this fails to allocate, so that it does not harm the machine.
MAX_MEMORY = 12 << 30


def first_line(output: IO[str], timeout_s: float) -> str:
    """The first line that a process prints; empty if none comes in time."""
    with selectors.DefaultSelector() as selector:
        selector.register(output, selectors.EVENT_READ)
        return output.readline().strip() if selector.select(timeout_s) else ""


class Process:
    """A process that is killed at the end of its block, also if it is stopped."""

    def __init__(
        self,
        command: Sequence[str],
        stderr: IO[str] | int | None = None,
        *,
        wait: bool = True,
        folder: Path = ELSEWHERE,
    ) -> None:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        environment.pop("PYTHONPATH", None)
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
        )
        self.pid = self.process.pid
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.stdin, self.stdout = self.process.stdin, self.process.stdout
        self.greeting = first_line(self.stdout, START_TIMEOUT_S) if wait else ""
        if wait and not self.greeting:
            self.end()
            raise RuntimeError(f"did not start: {' '.join(command)}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def go(self) -> None:
        """Tell it to begin; it has said that it is ready."""
        self.stdin.write("go\n")
        self.stdin.flush()

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.stdin, self.stdout):
            with contextlib.suppress(OSError):
                pipe.close()


class Server(Process):
    """A running ``zenoh-tf-server`` with its log in a file."""

    def __init__(self, python: str, *flags: str, endpoint: str | None = None) -> None:
        self.endpoint = endpoint or free_endpoint()
        self.python = python
        self._folder = tempfile.TemporaryDirectory()
        self.log_path = Path(self._folder.name, "log")
        with self.log_path.open("w") as log:
            super().__init__(
                [python, "-m", "zenoh_tf_server", "--listen", self.endpoint, *flags], log
            )
        resource.prlimit(self.pid, resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))

    @property
    def log(self) -> bytes:
        return self.log_path.read_bytes()

    def rss_mb(self) -> float:
        return status_mb(self.pid, "VmRSS")

    def end(self) -> None:
        super().end()
        self._folder.cleanup()

    def terminate(self, timeout_s: float = 10.0) -> tuple[int, float]:
        """Stop it as an init system does. Returns the exit status and the seconds it took."""
        start_s = time.monotonic()
        self.process.terminate()
        try:
            status = self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            status = 999
        return status, time.monotonic() - start_s


class Cost(NamedTuple):
    """What something cost the server."""

    wall_ms: float
    cpu_ms: float
    peak_mb: float  # growth of memory at its peak
    left_mb: float  # growth that stays


@contextlib.contextmanager
def costs(server: Server, settle_s: float = 1.0) -> Iterator[list[Cost]]:
    """Measure the block; the list has the cost after it."""
    Path(f"/proc/{server.pid}/clear_refs").write_text("5")  # forget the peak
    before_mb, start_s, start_cpu_s = server.rss_mb(), time.monotonic(), cpu_s(server.pid)
    found: list[Cost] = []
    yield found
    wall_ms = 1e3 * (time.monotonic() - start_s)
    if not server.running:
        found.append(Cost(wall_ms, float("inf"), float("inf"), float("inf")))
        return
    spent_ms = 1e3 * (cpu_s(server.pid) - start_cpu_s)
    peak_mb = status_mb(server.pid, "VmHWM")
    time.sleep(settle_s)
    found.append(Cost(wall_ms, spent_ms, peak_mb - before_mb, server.rss_mb() - before_mb))


class Call(NamedTuple):
    """One call of a probe. Times are of the machine's monotonic clock."""

    start_s: float
    end_s: float
    outcome: str  # "ok", or the error's class
    age_s: float  # of the newest data, in probes of kind "sensor"


class Probe(Process):
    """A client process that makes one kind of call at a steady rate and records each."""

    def __init__(self, server: Server, kind: str, period_s: float = 0.02) -> None:
        self.kind = kind
        self.period_s = period_s
        script = str(HERE / "probe.py")
        super().__init__([server.python, script, server.endpoint, kind, str(period_s)])

    def calls(self) -> list[Call]:
        """End the probe and return its calls."""
        with contextlib.suppress(BrokenPipeError):
            self.stdin.close()
        return [Call(*json.loads(line)) for line in self.stdout if line.startswith("[")]


def attacker(endpoint: str, kind: str, *arguments: str, wait: bool = True) -> Process:
    """A process that plays an attack of attackers.py; `go` begins it."""
    command = [sys.executable, "-m", "tests.attack.attackers", kind, endpoint, *arguments]
    return Process(command, wait=wait, folder=ROOT)


@contextlib.contextmanager
def plain_load(processes: int) -> Iterator[None]:
    """Processes that only use the processor."""
    spinner = "print('spins', flush=True)\nwhile True: pass"
    with contextlib.ExitStack() as stack:
        for _ in range(processes):
            stack.enter_context(Process([sys.executable, "-c", spinner]))
        yield
