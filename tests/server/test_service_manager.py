"""What systemd hears of a server: ready, alive while workers answer, stopping."""

from __future__ import annotations

import configparser
import contextlib
import functools
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh
from ruamel.yaml import YAML

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.support.waiting import wait_until
from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf._zenoh.link_sockets import LinkSocket, LinkSockets
from zenoh_tf._zenoh.outbox_links import OutboxLinks
from zenoh_tf.text.flag_values import size
from zenoh_tf_server import config_file, flags
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.monitoring import health, service_manager
from zenoh_tf_server.transport.clients import Clients

ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "server/systemd/zenoh-tf-server.service"
DOCKER = ROOT / "docker"


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """The socket of a service manager, which servers of the test will find."""
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(path))
        listening.settimeout(20)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        yield listening


def receive(manager: socket.socket) -> str:
    return manager.recv(4096).decode()


def test_ready_alive_and_stopping(
    manager: socket.socket, monkeypatch: pytest.MonkeyPatch, start_server: StartServer
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "300000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    server = start_server(tree="my\ntree")
    assert receive(manager).splitlines() == ["READY=1", "STATUS=serves tree 'my\\ntree'"]
    for _ in range(3):
        assert receive(manager) == "WATCHDOG=1"
    server.freeze()
    manager.settimeout(1.0)
    with pytest.raises(TimeoutError):
        while True:  # what was sent before the freeze
            assert receive(manager) == "WATCHDOG=1"
    manager.settimeout(20)
    assert server.stop() == 0
    while (message := receive(manager)) == "WATCHDOG=1":
        pass
    assert message == "STOPPING=1"


def test_a_watchdog_of_another_process_is_not_answered(
    manager: socket.socket, monkeypatch: pytest.MonkeyPatch, start_server: StartServer
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "300000")
    monkeypatch.setenv("WATCHDOG_PID", "1")
    server = start_server()
    assert receive(manager).startswith("READY=1")
    assert server.stop() == 0
    assert receive(manager) == "STOPPING=1"


def test_a_server_that_cannot_start_is_never_ready(
    manager: socket.socket, start_server: StartServer
) -> None:
    server = start_server()
    assert receive(manager).startswith("READY=1")
    command = [sys.executable, "-m", "zenoh_tf_server", "--listen", server.endpoint]
    assert subprocess.run(command, capture_output=True, timeout=150, check=False).returncode == 2
    assert server.stop() == 0
    assert receive(manager) == "STOPPING=1"


def test_an_abstract_socket_and_no_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    name = f"zenoh-tf-test-{time.monotonic_ns()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(f"\0{name}")
        listening.settimeout(20)
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        assert service_manager.notify(READY=1)
        assert receive(listening) == "READY=1"
    assert not service_manager.notify(READY=1)  # nobody listens any more
    monkeypatch.setenv("NOTIFY_SOCKET", "nonsense")
    assert not service_manager.notify(READY=1)
    monkeypatch.delenv("NOTIFY_SOCKET")
    assert not service_manager.notify(READY=1)


class Replies:
    """A session whose lookups are taken from the queue, and answered if `answering` is set."""

    def __init__(self, session: zenoh.Session) -> None:
        self.answering = threading.Event()
        self.held: list[zenoh.Query] = []
        self._queryable = session.declare_queryable(keys.request("main", "lookup"), self._serve)

    def _serve(self, query: zenoh.Query) -> None:
        if self.answering.is_set():
            query.reply(query.key_expr, wire.pack({"v": 1, "instance": "i"}))
        else:
            self.held.append(query)  # as a worker that hangs

    def close(self) -> None:
        self._queryable.undeclare()
        for query in self.held:
            query.drop()


def test_workers_that_hang_are_unhealthy(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process lives, and so does its session: only the lookups stay without an answer."""
    monkeypatch.setattr(health, "HEALTHY_FOR_S", 0.3)
    with zenoh.open(zenoh_config.router([free_endpoint()])) as session:
        replies = Replies(session)
        replies.answering.set()
        answered = threading.Semaphore(0)
        probing = health.Health(0.01, 0.05)
        probing.answered = answered.release
        service: Any = SimpleNamespace(name="main", instance="i")
        own = SimpleNamespace(own="self")
        server: Any = SimpleNamespace(
            session=session,
            service=service,
            clients=own,
            key=functools.partial(keys.request, "main"),
        )
        probing.serving(server)
        for _ in range(3):
            assert answered.acquire(timeout=20)
        assert probing.healthy and probing.ready
        replies.answering.clear()
        wait_until(lambda: not probing.healthy)
        while answered.acquire(timeout=0.2):
            pass
        assert not probing.healthy  # and the watchdog gets nothing
        replies.answering.set()
        assert answered.acquire(timeout=20)
        probing.stopping()
        assert not probing.ready
        replies.close()


def test_a_reply_of_another_server_does_not_count() -> None:
    key = keys.request("main", "lookup")
    with zenoh.open(zenoh_config.router([free_endpoint()])) as session:
        assert health.probe(session, key, "i", "self", 1.0) is not None  # no queryable
        replies = Replies(session)
        replies.answering.set()
        assert health.probe(session, key, "i", "self", 1.0) is None
        assert health.probe(session, key, "j", "self", 1.0) == "the reply is not of this server"
        replies.close()


def test_the_reply_to_a_probe_waits_for_no_client() -> None:
    """The reply to any other unknown sender may go to every link, and waits for a full one."""
    ours, theirs = socket.socketpair()
    config = zenoh_config.router([free_endpoint()])
    with ours, theirs, zenoh.open(config) as session:
        ours.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                ours.send(b"x" * 65536)
        sockets, clients = LinkSockets(session), Clients(10)
        full = LinkSocket(ours.fileno(), os.fstat(ours.fileno()).st_ino)
        sockets._by_peer["frozen"] = {"link": full}
        links = OutboxLinks(sockets, clients)
        assert links.room("") == 0
        assert clients.known("self") == ""
        own = clients.known(clients.own)
        assert own and (links.room(own) or 0) > 1000
        assert links.full_link(own) is None and not links.is_blind(own)
        sockets.close()


def unit() -> configparser.RawConfigParser:
    class Repeated(dict[str, Any]):
        """systemd allows a key more than once."""

        def __setitem__(self, key: str, value: Any) -> None:
            if isinstance(value, list) and isinstance(self.get(key), list):
                value = self[key] + value
            super().__setitem__(key, value)

    parsed = configparser.RawConfigParser(dict_type=Repeated, strict=False)
    parsed.optionxform = str  # type: ignore[assignment,method-assign]
    parsed.read_string(UNIT.read_text())
    return parsed


def test_the_units_flags_are_flags_of_the_server() -> None:
    program, *arguments = unit()["Service"]["ExecStart"].split()
    assert program.endswith("/zenoh-tf-server")
    options = flags.parser().parse_args(arguments)
    flags.complete(flags.parser(), options)
    assert options.log_format == "json" and options.metrics


def test_a_server_reaches_its_limits_before_the_kernel_kills_it() -> None:
    """The unit and the compose files allow more memory than the server's own limits do."""
    limits = Limits()
    queued = limits.pending_bytes + limits.all_unread_reply_bytes + limits.put_queues_bytes
    kept = limits.outcome_bytes + limits.change_log_bytes + limits.stream_bytes
    service = unit()["Service"]
    deployed = [(service["ExecStart"].split()[1:], service["MemoryMax"])]
    base, *others = (
        YAML(typ="safe").load(DOCKER / name)["services"]["server"]
        for name in ("compose.yaml", "compose.monitoring.yaml", "compose-ros2.yaml")
    )
    deployed += [(each["command"], base["mem_limit"]) for each in (base, *others)]
    secured = YAML(typ="safe").load(DOCKER / "compose-tls.yaml")["services"]["server"]
    deployed.append((["--config", str(DOCKER / "server-tls.toml")], secured["mem_limit"]))
    for arguments, allowed in deployed:
        options = config_file.parse_arguments(flags.parser(), arguments)
        assert options.max_memory + queued + kept < size(1)(allowed.upper()), arguments


def test_the_unit_is_valid(tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not installed")
    copy = tmp_path / UNIT.name
    program = unit()["Service"]["ExecStart"].split()[0]
    copy.write_text(UNIT.read_text().replace(f"ExecStart={program}", f"ExecStart={sys.executable}"))
    done = subprocess.run(
        [analyze, "verify", copy], capture_output=True, text=True, timeout=150, check=False
    )
    problems = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert not problems
