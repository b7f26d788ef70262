"""Fixtures for all tests: servers, replicas, clients and event loops."""

from __future__ import annotations

import asyncio
import inspect
import signal
import sys
import tempfile
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvloop

from tests.processes.ports import free_endpoint
from tests.processes.servers import Pool, ServerProcess, starts
from tests.support.both_clients import Blocking, LoopThread
from tests.support.raw import Raw, raw
from tests.support.runs import CONTROLS
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session.mapped_tree import Mode

__all__ = ["ServerProcess", "free_endpoint"]

S = 1_000_000_000

linux = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")

# A shell that starts the tests in the background makes them, and their children, ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    help = "print how many servers the tests have started"
    parser.addoption("--count-servers", action="store_true", help=help)


#: The files that take longest begin first, so that none of them runs on alone at the end.
_LONGEST = {
    *("test_bench_parts.py", "test_chaos.py", "test_core.py", "test_faults.py", "test_checks.py"),
    *("test_exit.py", "test_state_kills.py", "test_unread_replies.py", "test_demo.py"),
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name not in _LONGEST)
    for item in items:
        if "start_server" in getattr(item, "fixturenames", ()) or "[remote" in item.name:
            item.add_marker("service")


#: How many servers the workers of pytest-xdist have started, for the process that prints it.
_of_workers: list[int] = []


def pytest_sessionfinish(session: pytest.Session) -> None:
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["server_starts"] = starts()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    _of_workers.append(getattr(node, "workeroutput", {}).get("server_starts", 0))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    if config.getoption("--count-servers"):
        total = starts() + sum(_of_workers)
        terminalreporter.write_line(f"{total} servers were started")


#: What runs on an event loop.
Main = Callable[[], Coroutine[Any, Any, None]]


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


@pytest.fixture(scope="session")
def server_pool(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pool]:
    pool = Pool(tmp_path_factory.mktemp("servers"))
    yield pool
    pool.stop()


#: ``lend_server(*flags)``: a server that is shared with other tests, with an empty tree.
LendServer = Callable[..., ServerProcess]


@pytest.fixture
def lend_server(
    request: pytest.FixtureRequest, server_pool: Pool, start_server: StartServer
) -> LendServer:
    """A test that is marked ``own_server`` gets servers of its own."""
    own = request.node.get_closest_marker("own_server") is not None
    return start_server if own else server_pool.lend


@pytest.fixture(scope="module")
def shared_server(server_pool: Pool) -> ServerProcess:
    """A server with the defaults for all tests of a file, whose tree is empty at first."""
    return server_pool.lend(of_file=True)


@pytest.fixture
def server(lend_server: LendServer) -> ServerProcess:
    """A server with the defaults."""
    return lend_server()


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


@pytest.fixture(params=CONTROLS)
def any_server(request: pytest.FixtureRequest, lend_server: LendServer) -> ServerProcess:
    """A server for each concurrency control in turn."""
    return lend_server("--concurrency", request.param)


@pytest.fixture
def client(server: ServerProcess) -> Iterator[TransformClient]:
    """A client of `server`."""
    with server.connect() as tf:
        yield tf


@pytest.fixture
def wires(server: ServerProcess) -> Iterator[Raw]:
    """Raw messages to `server`."""
    with raw(server.endpoint) as session:
        yield session


@pytest.fixture(scope="session")
def runtime_folder() -> Iterator[Path]:
    """One folder for the sockets of all servers that are lent, so that tests can share these."""
    with tempfile.TemporaryDirectory() as path:
        yield Path(path)


@pytest.fixture(params=["synchronous", pytest.param("socket", marks=linux), "asynchronous"])
def either_client(
    request: pytest.FixtureRequest, runtime_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Servers connect clients of both kinds in turn; a synchronous one that sends its queries over
    Zenoh, and one that sends them through the server's socket."""
    if request.param == "socket":
        monkeypatch.setattr(ServerProcess, "LOCAL", True)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime_folder))
    if request.param != "asynchronous":
        yield
        return
    thread = LoopThread()

    def connect(server: ServerProcess, timeout_s: float = 5.0, reads: Mode = "query") -> Blocking:
        return Blocking.connect(thread, server.endpoint, server.tree, timeout_s, reads=reads)

    monkeypatch.setattr(ServerProcess, "connect", connect)
    yield
    thread.stop()


@pytest.fixture(params=CONTROLS)
def tree(request: pytest.FixtureRequest) -> TransformTree:
    """map -> base at 10 s and 20 s, base -> camera static, base -> arm at 12 s and 18 s."""
    tree = TransformTree(cache_time_s=10.0, concurrency=request.param)
    for stamp in (10, 20):
        row = StampedTransform("map", "base", stamp * S, Transform((stamp, 0, 0)))
        tree.set_transform(row, authority="odometry")
    for stamp in (12, 18):
        row = StampedTransform("base", "arm", stamp * S, Transform((1, 0, 0)))
        tree.set_transform(row, authority="joints")
    mount = StampedTransform("base", "camera", 0, Transform((0.5, 0, 0)))
    tree.set_transform(mount, authority="urdf", static=True)
    return tree


@pytest.fixture(params=[asyncio.run, uvloop.run], ids=["asyncio", "uvloop"])
def run(request: pytest.FixtureRequest) -> Callable[[Main], None]:
    """``run(main)`` on either loop; nothing may be logged or left behind by it."""

    def run_on_loop(main: Main) -> None:
        reports: list[dict[str, Any]] = []

        async def reported() -> None:
            loop = asyncio.get_running_loop()
            loop.set_exception_handler(lambda _, report: reports.append(report))
            await main()

        request.param(reported())
        assert reports == []

    return run_on_loop


def pytest_pycollect_makeitem(name: str, obj: Any) -> None:
    """A test that is a coroutine function runs by `run`."""
    if name.startswith("test_") and inspect.iscoroutinefunction(obj):
        pytest.mark.usefixtures("run")(obj)


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    arguments = {name: pyfuncitem.funcargs[name] for name in names}
    run: Any = pyfuncitem.funcargs["run"]
    run(lambda: pyfuncitem.obj(**arguments))
    return True
