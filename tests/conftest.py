"""Real servers for the tests: processes on free ports."""

from __future__ import annotations

import asyncio
import contextlib
import os
import queue
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvloop

from zenoh_tf_client import TransformClient
from zenoh_tf_client.connection import Connection
from zenoh_tf_client.shared_reads import Mode

from .both_clients import Blocking, LoopThread

#: Only a server that hangs takes so long: pytest gives up on the test soon after.
START_TIMEOUT_S = 50.0
#: Below all ports that systems give to outgoing connections.
_PORTS = range(10_000, 30_000)

linux = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")

# A shell that starts the tests in the background makes them, and their children, ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


def free_port() -> int:
    """A port of 127.0.0.1 that nothing listens on.

    A port that the system chooses could be taken by any outgoing connection before the server
    listens on it, or while the server restarts: even by a client that tries to reconnect to it,
    and so is connected to itself.
    """
    while True:
        port = random.SystemRandom().choice(_PORTS)  # Hypothesis seeds the shared one
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def free_endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


#: What runs on an event loop.
Main = Callable[[], Coroutine[Any, Any, None]]


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
        where = () if "--connect" in flags else ("--listen", endpoint)
        with log.open("a") as errors:
            self.process = subprocess.Popen(
                [sys.executable, *self.START, *where, "--tree", tree, *flags],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
        self.greeting = self._first_line()

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
        """Return what it has logged so far."""
        return self._log.read_text()

    def wait_for_log(self, text: str) -> None:
        """Wait until it has logged this text."""
        deadline_s = time.monotonic() + START_TIMEOUT_S
        while text not in self.log:
            assert time.monotonic() < deadline_s, f"no {text!r} in the log:\n{self.log}"
            time.sleep(0.01)

    def connect(self, timeout_s: float = 5.0, reads: Mode = "query") -> TransformClient:
        """A client; most tests are about queries, so these are the default."""
        if self.LOCAL and reads == "query":
            return TransformClient(Connection(self.endpoint, self.tree, timeout_s), reads)
        return TransformClient.connect(self.endpoint, self.tree, timeout_s, reads=reads)

    def send_signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def freeze(self) -> None:
        """Stop all of its threads, and return when they have stopped."""
        self.process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self.process.pid, os.WSTOPPED)

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


StartServer = Callable[..., ServerProcess]


@pytest.fixture
def start_server(tmp_path: Path) -> Iterator[StartServer]:
    """``start_server(*flags, endpoint=..., tree=...)``: a server, stopped after the test."""
    running: list[ServerProcess] = []

    def start(*flags: str, endpoint: str | None = None, tree: str = "main") -> ServerProcess:
        log = tmp_path / f"server-{len(running)}.log"
        server = ServerProcess(log, endpoint or free_endpoint(), tree, flags)
        running.append(server)
        return server

    yield start
    for server in running:
        server.stop()


@pytest.fixture
def socket_folder() -> Iterator[Path]:
    """A folder whose path is short enough for sockets."""
    with tempfile.TemporaryDirectory() as path:
        yield Path(path)


@pytest.fixture
def start_sharing(start_server: StartServer, socket_folder: Path) -> StartServer:
    """``start_server``, of servers that share their trees through sockets in `socket_folder`."""

    def start(*flags: str, **options: Any) -> ServerProcess:
        return start_server("--share-dir", str(socket_folder), *flags, **options)

    return start


@pytest.fixture
def server(start_server: StartServer) -> ServerProcess:
    """A server with the defaults, on an endpoint of its own."""
    return start_server()


@pytest.fixture
def start_replica(start_server: StartServer) -> StartServer:
    """``start_replica(*servers, ...)``: a replica with links to these servers."""

    def start(
        *servers: ServerProcess, endpoint: str | None = None, flags: tuple[str, ...] = ()
    ) -> ServerProcess:
        links = [word for each in servers for word in ("--replica-of", each.endpoint)]
        return start_server(*links, *flags, endpoint=endpoint)

    return start


@pytest.fixture
def primary(start_server: StartServer) -> ServerProcess:
    return start_server()


@pytest.fixture
def replica(primary: ServerProcess, start_replica: StartServer) -> ServerProcess:
    return start_replica(primary)


@pytest.fixture
def near(replica: ServerProcess) -> Iterator[TransformClient]:
    """A client of the replica's router."""
    with replica.connect(10) as tf:
        yield tf


@pytest.fixture(params=["optimistic", "2pl", "giant"])
def any_server(request: pytest.FixtureRequest, start_server: StartServer) -> ServerProcess:
    """A server for each concurrency control in turn."""
    return start_server("--concurrency", request.param)


@pytest.fixture
def client(server: ServerProcess) -> Iterator[TransformClient]:
    """A client of `server`."""
    with server.connect() as tf:
        yield tf


@pytest.fixture(params=["synchronous", pytest.param("socket", marks=linux), "asynchronous"])
def either_client(
    request: pytest.FixtureRequest, socket_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Servers connect clients of both kinds in turn; a synchronous one that sends its queries over
    Zenoh, and one that sends them through the server's socket."""
    if request.param == "socket":
        monkeypatch.setattr(ServerProcess, "LOCAL", True)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(socket_folder))
    if request.param != "asynchronous":
        yield
        return
    thread = LoopThread()

    def connect(server: ServerProcess, timeout_s: float = 5.0, reads: Mode = "query") -> Blocking:
        return Blocking.connect(thread, server.endpoint, server.tree, timeout_s, reads=reads)

    monkeypatch.setattr(ServerProcess, "connect", connect)
    yield
    thread.stop()


@pytest.fixture(params=[asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"])
def run(request: pytest.FixtureRequest) -> Iterator[Callable[[Main], None]]:
    """``run(main)`` on either loop; nothing may be logged or left behind by it."""

    def run_on_loop(main: Main) -> None:
        reports: list[dict[str, Any]] = []

        async def reported() -> None:
            loop = asyncio.get_running_loop()
            loop.set_exception_handler(lambda _, report: reports.append(report))
            await main()

        with asyncio.Runner(loop_factory=request.param) as runner:
            runner.run(reported())
        assert reports == []

    yield run_on_loop
