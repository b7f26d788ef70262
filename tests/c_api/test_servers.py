"""C++ readers beside real servers: what they see, and what becomes of them without one."""

from __future__ import annotations

import random
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes import torn
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform

from .readers import Reader

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")

#: No test waits for so long: it is for lookups that must succeed.
LONG_MS = 120_000


def set_x(server: ServerProcess, x: float) -> None:
    with server.connect() as tf:
        tf.set_transform(StampedTransform("map", "base", time.time_ns(), Transform((x, 0, 0))))


def x_of(reader: Reader, timeout_ms: int = 0) -> float:
    return float(reader.do("lookup", "map", "base", "-", timeout_ms)[1])


@pytest.fixture
def reader() -> Iterator[Reader]:
    with Reader() as reader:
        yield reader


def test_it_reads_what_clients_write(
    start_sharing: StartServer, socket_folder: Path, reader: Reader
) -> None:
    server = start_sharing(tree="a/bü")
    reader.do("open", server.tree, socket_folder, 0)
    assert reader.ask("lookup", "map", "base", "-", 0)[0] == "ZTF_LOOKUP"
    for x in range(5):
        set_x(server, x)
        assert x_of(reader) == x
    with server.connect() as tf:
        assert reader.do("server") == ["1", tf.instance]


def test_it_finds_the_default_folder(
    start_server: StartServer, socket_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(socket_folder))
    set_x(start_server(), 3)
    assert (socket_folder / "zenoh-tf").is_dir()
    with Reader() as reader:
        reader.do("open", "main", "default", 0)
        assert x_of(reader) == 3


@pytest.mark.parametrize("ends_by", [signal.SIGKILL, signal.SIGTERM])
def test_it_survives_its_server(
    start_sharing: StartServer, socket_folder: Path, reader: Reader, ends_by: signal.Signals
) -> None:
    server = start_sharing()
    set_x(server, 1)
    reader.do("open", "main", socket_folder, 0)
    assert x_of(reader) == 1
    for round_, x in enumerate((2.0, 3.0, 4.0)):
        server.send_signal(ends_by)
        server.stop()
        wait_until(lambda: reader.ask("lookup", "map", "base", "-", 0)[0] != "ok")
        code, _ = reader.ask("lookup", "map", "base", "-", 10)
        assert code == "ZTF_SERVER_UNAVAILABLE"
        server = start_sharing(endpoint=server.endpoint)
        set_x(server, x)
        assert x_of(reader, LONG_MS) == x
        assert reader.do("server")[0] == str(round_ + 2)


def test_a_server_that_stops_for_a_while(
    start_sharing: StartServer, socket_folder: Path, reader: Reader
) -> None:
    server = start_sharing()
    set_x(server, 1)
    reader.do("open", "main", socket_folder, 0)
    server.freeze()
    wait_until(lambda: reader.ask("lookup", "map", "base", "-", 0)[0] != "ok")
    assert reader.ask("lookup", "map", "base", "-", 0)[0] == "ZTF_SERVER_UNAVAILABLE"
    server.send_signal(signal.SIGCONT)
    assert x_of(reader, LONG_MS) == 1
    assert reader.do("server")[0] == "1"  # the same memory


def test_no_read_is_torn_while_servers_are_killed(
    start_sharing: StartServer, socket_folder: Path, reader: Reader
) -> None:
    rng = random.Random(1)
    server = start_sharing()
    rounds = 4
    for round_ in range(rounds):
        with server.connect() as tf:
            tf.set_transforms_xact(torn.zero_sum(rng, time.time_ns()))
            if round_ == 0:
                reader.do("open", "main", socket_folder, 0)
                reader.do("watch", torn.ROOT, torn.LEAF)
            reader.do("lookup", torn.ROOT, torn.LEAF, "-", LONG_MS)
            enough = int(reader.do("watched")[0]) + 1000
            done = threading.Event()
            writer = threading.Thread(target=write_until, args=(tf, rng, done))
            writer.start()
            wait_for_answers(reader, enough)
            server.kill()
            done.set()
            writer.join()
        wait_until(lambda: reader.ask("lookup", torn.ROOT, torn.LEAF, "-", 0)[0] != "ok")
        if round_ < rounds - 1:
            server = start_sharing(endpoint=server.endpoint)
    answered, unavailable, _, torn_reads, _ = map(int, reader.do("watched"))
    assert answered > 1000 * rounds
    assert unavailable > 0
    assert torn_reads == 0


def wait_for_answers(reader: Reader, count: int) -> None:
    wait_until(lambda: int(reader.do("watched")[0]) > count)


def write_until(tf: torn.Sets, rng: random.Random, done: threading.Event) -> None:
    while not done.is_set():
        try:
            tf.set_transforms_xact(torn.zero_sum(rng, time.time_ns()))
        except Exception:  # the server was killed meanwhile
            return


def test_a_folder_that_others_may_write_to_is_not_trusted(
    start_sharing: StartServer, socket_folder: Path, reader: Reader
) -> None:
    start_sharing()
    socket_folder.chmod(0o777)
    assert reader.ask("open", "main", socket_folder, 0)[0] == "ZTF_ACCESS_DENIED"


def test_two_servers_of_one_tree_are_told_apart(
    start_sharing: StartServer, socket_folder: Path, reader: Reader
) -> None:
    first, second = start_sharing(), start_sharing()
    code, words = reader.ask("open", "main", socket_folder, 0)
    assert code == "ZTF_INVALID_ARGUMENT"
    assert "--share-dir" in " ".join(words)
    second.kill()
    set_x(first, 5)
    wait_until(lambda: reader.ask("open", "main", socket_folder, 0)[0] == "ok")
    assert x_of(reader) == 5
