"""Real servers for the tests: processes on ports of their own."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
from pathlib import Path

from tests.support.waiting import wait_until
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session.connection import Connection
from zenoh_tf_client.session.mapped_tree import MappedTree, Mode

from . import forks
from .ports import free_endpoint

#: Only a server that hangs takes so long: pytest gives up on the test soon after.
START_TIMEOUT_S = 150.0

_starts = 0


def count_start() -> None:
    global _starts  # noqa: PLW0603
    _starts += 1


def starts() -> int:
    """How many servers this process has started so far."""
    return _starts


#: How long a put has waited depends on the machine, as does which frames are back how long after a
#: server's start, so only tests of these limits have their defaults.
TIMELESS = {"put_wait_ms": 600_000, "startup_ms": 1}


class ServerProcess:
    """A running ``zenoh-tf-server``."""

    #: How Python starts it.
    START: tuple[str, ...] = ("-m", "zenoh_tf_server")
    #: Clients send queries through the server's socket.
    LOCAL = False

    def __init__(self, log: Path, endpoint: str, tree: str, flags: tuple[str, ...]) -> None:
        self.endpoint = endpoint
        self.tree = tree
        self._log = log
        self._log_from = 0
        where = () if "--connect" in flags else ("--listen", endpoint)
        for limit, value in TIMELESS.items():
            if not any(limit in flag for flag in flags):
                flags = (*flags, "--limit", f"{limit}={value}")
        with log.open("a") as errors:
            # Code of a subclass may change what an import does.
            start = forks.Popen if self.START[0] == "-m" else subprocess.Popen
            self.process = start(
                [sys.executable, *self.START, *where, "--tree", tree, *flags],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
        self.greeting = self._first_line()
        count_start()

    def _first_line(self) -> str:
        lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        assert self.process.stdout is not None
        reader = threading.Thread(
            target=lambda output: lines.put(output.readline()), args=(self.process.stdout,)
        )
        reader.start()
        try:
            line = lines.get(timeout=START_TIMEOUT_S)
        except queue.Empty:
            line = ""
        if not line:
            self.process.kill()
        reader.join()
        if not line:
            self.process.wait()
            self.process.stdout.close()
            raise AssertionError(f"the server did not start:\n{self.log}")
        return line.strip()

    @property
    def log(self) -> str:
        """Return what it has logged so far, or since it was emptied."""
        return self._log.read_text()[self._log_from :]

    def wait_for_log(self, text: str) -> None:
        """Wait until it has logged this text."""
        wait_until(lambda: text in self.log, lambda: f"no {text!r} in the log:\n{self.log}")

    def connect(self, timeout_s: float = 5.0, reads: Mode = "query") -> TransformClient:
        """A client; most tests are about queries, so these are the default."""
        if self.LOCAL and reads == "query":
            connection = Connection(self.endpoint, self.tree, timeout_s)
            return TransformClient(connection, MappedTree(connection, reads))
        return TransformClient.connect(self.endpoint, self.tree, timeout_s, reads=reads)

    def empty(self) -> None:
        """Make it as good as new for another test: its tree is empty, and so is its log."""
        self.process.send_signal(signal.SIGCONT)
        with TransformClient.connect(
            self.endpoint, self.tree, START_TIMEOUT_S, reads="query"
        ) as tf:
            tf.reset()
        self._log_from = len(self._log.read_text())

    def send_signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def freeze(self) -> None:
        """Stop all of its threads, and return when they have stopped."""
        self.process.send_signal(signal.SIGSTOP)
        forks.wait_until_stopped(self.process.pid)

    def kill(self) -> None:
        """As ``kill -9``."""
        self.process.kill()
        self._end()

    def stop(self) -> int:
        """Stop it as an init system does (SIGTERM); return its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
        return self._end()

    def _end(self) -> int:
        try:
            return self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()
        finally:
            if self.process.stdout is not None:
                self.process.stdout.close()


def refused(*flags: str, **environment: str) -> str:
    """Run a server that must not start. Returns what it wrote to standard error."""
    command = [sys.executable, "-m", "zenoh_tf_server", *flags]
    done = forks.run(command, timeout=START_TIMEOUT_S, env={**os.environ, **environment})
    assert done.returncode == 2, done.stderr
    assert done.stdout == "" and "Traceback" not in done.stderr
    return done.stderr.strip()


class Pool:
    """Servers for all tests of this process, one for each set of flags.

    Who asks gets it with an empty tree. A test may kill it: the next one gets a new one. Those of
    whole files (`of_file`) are others than those of single tests, which empty and freeze theirs.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._servers: dict[tuple[str | bool | None, ...], ServerProcess] = {}

    def lend(self, *flags: str, of_file: bool = False) -> ServerProcess:
        # A server shares its tree through a socket in this folder.
        key = (os.environ.get("XDG_RUNTIME_DIR"), of_file, *flags)
        server = self._servers.get(key)
        if server is not None and server.process.poll() is not None:
            server.stop()
            server = None
        if server is None:
            log = self._folder / f"server-{len(self._servers)}.log"
            server = self._servers[key] = ServerProcess(log, free_endpoint(), "main", flags)
        else:
            server.empty()
        return server

    def stop(self) -> None:
        for server in self._servers.values():
            server.stop()
