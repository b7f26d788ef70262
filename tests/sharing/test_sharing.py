"""Clients that read the memory of a server on the same host: what they see, and when not."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.threads import together
from tests.support.waiting import wait_until
from zenoh_tf import (
    InvalidArgumentException,
    LookupException,
    ServerUnavailable,
    StampedTransform,
    Transform,
)
from zenoh_tf._net import handover
from zenoh_tf.shared_tree import SharedTree
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session.mapped_tree import NO_TREE

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")

ROOT = Path(__file__).resolve().parents[2]


def link(x: float, child: str = "base") -> StampedTransform:
    return StampedTransform("map", child, time.time_ns(), Transform((x, 0, 0)))


def becomes_shared(tf: TransformClient) -> bool:
    """Whether lookups are shared now; one that is not shared lets the client look for a server."""
    try:
        tf.can_transform("map", "base")
    except ServerUnavailable:
        return False
    return tf.reads == "shared"


def asked(tf: TransformClient) -> int:
    """How many lookups this client asked the server for."""
    return sum(count for name, count in tf.stats().items() if name.startswith("reads_asked"))


def test_reads_are_shared_and_see_the_clients_own_writes(server: ServerProcess) -> None:
    with server.connect(reads="shared") as tf:
        assert tf.reads == "shared"
        for x in range(20):
            tf.set_transform(link(x))
            assert tf.lookup_transform("map", "base").transform.translation[0] == x
        stats = tf.stats()
        assert stats["reads_shared"] == stats["reads_mapped"] == 1
        assert asked(tf) == 0
    with pytest.raises(ServerUnavailable, match="closed"):
        tf.lookup_transform("map", "base")


class Counted(TransformClient):
    """A client with a method of its own in the place of one that reads memory."""

    count = 0

    def lookup_transform(self, *arguments: Any, **options: Any) -> StampedTransform:
        self.count += 1
        return super().lookup_transform(*arguments, **options)


def test_a_subclass_keeps_its_methods(server: ServerProcess) -> None:
    with Counted.connect(server.endpoint) as tf:
        tf.set_transform(link(1))
        assert tf.lookup_transform("map", source="base").transform.translation[0] == 1
        assert tf.lookup_latest_transform("map", "base").transform.translation[0] == 1
        assert tf.count == 1 and asked(tf) == 0


def test_a_method_that_is_kept_keeps_the_connection(server: ServerProcess) -> None:
    with server.connect() as other:
        other.set_transform(link(1))
        look = server.connect(reads="shared").lookup_transform
        gc.collect()
        assert look("map", "base", timeout_s=0.0).transform.translation[0] == 1
        timer = threading.Timer(0.2, lambda: other.set_transform(link(2, "later")))
        timer.start()
        assert look("map", "later", timeout_s=30).transform.translation[0] == 2
        timer.join()


def test_reads_can_be_queries(server: ServerProcess) -> None:
    with server.connect(reads="query") as tf:
        assert tf.reads == "query"
        assert not tf.can_transform("map", "base")
        assert tf.stats()["reads_refused_not_chosen"] == 1
    with pytest.raises(InvalidArgumentException) as caught:
        server.connect(reads="fast")  # type: ignore[arg-type]
    assert caught.value.field == "reads"


def test_a_lookup_waits_at_the_server(server: ServerProcess) -> None:
    with server.connect(reads="shared") as tf, server.connect() as other:
        timer = threading.Timer(0.2, lambda: other.set_transform(link(7)))
        timer.start()
        assert tf.lookup_transform("map", "base", timeout_s=30).transform.translation[0] == 7
        timer.join()
        assert tf.stats()["reads_asked_waiting"] == 1
        tf.lookup_transform("map", "base", timeout_s=30)
        assert tf.stats()["reads_asked_waiting"] == 1


def test_a_transaction_is_one_query(server: ServerProcess) -> None:
    with server.connect(reads="shared") as tf:
        tf.set_transform(link(0))
        asked_before = asked(tf)

        def count(tx: Any) -> None:
            seen = tx.lookup_latest_transform_xact("map", "base").transform.translation[0]
            assert tx.can_transform("map", "base") and not tx.can_transform("map", "nobody")
            with pytest.raises(LookupException):
                tx.lookup_transform("map", "nobody")
            tx.set_transform(link(seen + 1))

        together(*4 * [lambda: [tf.run_transaction(count, attempts=1000) for _ in range(25)]])
        assert tf.lookup_transform("map", "base").transform.translation[0] == 100
        assert asked(tf) == asked_before


class Reader(threading.Thread):
    """Looks up as fast as it can, and keeps what each lookup saw, and when it began."""

    def __init__(self, tf: TransformClient) -> None:
        super().__init__()
        self._tf = tf
        self._stop_asked = threading.Event()
        self.seen: list[tuple[float, float | None]] = []  # (begin, x; None: no answer)
        self.start()

    def run(self) -> None:
        while not self._stop_asked.is_set():
            begin_s = time.monotonic()
            try:
                x = self._tf.lookup_transform("map", "base").transform.translation[0]
            except (ServerUnavailable, LookupException):
                x = None
            if not self.seen or self.seen[-1][1] != x or begin_s - self.seen[-1][0] > 0.001:
                self.seen.append((begin_s, x))

    def stop(self) -> None:
        self._stop_asked.set()
        self.join(60)
        assert not self.is_alive()


@pytest.mark.parametrize("attempt", range(3))
def test_no_answer_is_from_a_killed_server_once_its_successor_has_committed(
    start_sharing: StartServer, attempt: int
) -> None:
    endpoint = free_endpoint()
    first = start_sharing(endpoint=endpoint)
    with first.connect(reads="shared") as tf:
        tf.set_transform(link(1))
        reader = Reader(tf)
        try:
            time.sleep(0.1)
            first.kill()
            second = start_sharing(endpoint=endpoint)
            with second.connect() as writer:
                writer.set_transform(link(2))
                committed_s = time.monotonic()
            wait_until(lambda: becomes_shared(tf))
            wait_until(lambda: reader.seen[-1][1] == 2)
        finally:
            reader.stop()
        assert any(x == 1 for _, x in reader.seen)
        late = [x for begin_s, x in reader.seen if begin_s > committed_s]
        assert late and set(late) <= {2, None}
        assert late[-1] == 2
        assert tf.stats()["reads_mapped"] == 2


def test_a_stopped_server_is_asked_and_read_again_when_it_goes_on(
    start_sharing: StartServer,
) -> None:
    server = start_sharing()
    with server.connect(1.0, reads="shared") as tf:
        tf.set_transform(link(1))
        server.freeze()
        wait_until(lambda: tf.reads == "query")
        with pytest.raises(ServerUnavailable):
            tf.lookup_transform("map", "base")
        server.send_signal(signal.SIGCONT)
        wait_until(lambda: becomes_shared(tf))
        assert tf.lookup_transform("map", "base").transform.translation[0] == 1
        # Stopped for so long that its memory is given up.
        server.freeze()
        wait_until(lambda: tf._mapped.tree.lease_left_s == 0.0)
        server.send_signal(signal.SIGCONT)
        wait_until(lambda: becomes_shared(tf))
        assert tf.stats()["reads_mapped"] == 2


def test_all_clients_of_a_connection_follow_its_memory(server: ServerProcess) -> None:
    class Other:  # such as the asynchronous client of `tf2`'s message filters
        _tree: SharedTree

    other = Other()
    with server.connect(reads="shared") as tf:
        tf._mapped.attach(other)
        assert tf._tree is other._tree is tf._mapped.tree is not NO_TREE
    assert tf._tree is other._tree is NO_TREE


def test_a_server_without_sharing_is_asked(start_server: StartServer) -> None:
    server = start_server("--no-share")
    with server.connect(reads="shared") as tf:
        assert tf.reads == "query"
        tf.set_transform(link(1))
        assert tf.lookup_transform("map", "base").transform.translation[0] == 1
        stats = tf.stats()
        assert stats["reads_refused_not_offered"] == 1 and stats["reads_asked_absent"] == 1


def test_another_layout_is_refused_with_a_clear_line(
    server: ServerProcess, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(handover, "LAYOUT", (0, 17))
    with caplog.at_level(logging.INFO, "zenoh_tf.client"), server.connect(reads="shared") as tf:
        assert tf.reads == "query"
        assert not tf.can_transform("map", "base")
        assert tf.stats()["reads_refused_other_layout"] == 1
    [line] = [each for each in caplog.messages if "layout" in each]
    assert "this client reads 0 (0000000000000011): install the same version" in line


def test_another_host_is_asked(server: ServerProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handover, "boot_id", lambda: "another")
    with server.connect(reads="shared") as tf:
        assert tf.reads == "query"
        assert tf.stats()["reads_refused_other_host"] == 1


def test_a_user_without_permission_asks(start_sharing: StartServer, socket_folder: Path) -> None:
    server = start_sharing()
    socket_folder.chmod(0o755)
    script = """
import os, sys
from zenoh_tf_client import TransformClient
if os.getuid() == 0:
    os.setuid(65534)
else:
    [os.chmod(entry.path, 0) for entry in os.scandir(sys.argv[2])]
with TransformClient.connect(sys.argv[1]) as tf:
    assert not tf.can_transform("map", "base")
    print(tf.reads, tf.stats()["reads_refused_no_permission"])
"""
    done = forks.run(
        [sys.executable, "-c", script, server.endpoint, str(socket_folder)],
        timeout=150,
    )
    assert done.stdout.split() == ["query", "1"], done.stderr


def test_a_socket_in_another_folder_is_found(
    start_sharing: StartServer, socket_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a container, which has the folder of the server's socket elsewhere."""
    server = start_sharing()
    with tempfile.TemporaryDirectory() as runtime:
        [path] = socket_folder.glob("*.sock")
        (Path(runtime) / "zenoh-tf").mkdir()
        path.rename(Path(runtime) / "zenoh-tf" / path.name)
        with server.connect(reads="shared") as tf:
            assert tf.reads == "query"
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        with server.connect(reads="shared") as tf:
            assert tf.reads == "shared"


def mapped_regions() -> int:
    return Path("/proc/self/maps").read_text().count("memfd:zenoh-tf")


def test_connections_leave_nothing_behind(start_sharing: StartServer) -> None:
    gc.collect()
    regions = mapped_regions()  # those of other tests' servers
    server = start_sharing()
    with server.connect(reads="shared"):
        pass
    wait_until(lambda: mapped_regions() <= regions)
    descriptors = len(os.listdir("/proc/self/fd"))
    of_server = f"/proc/{server.process.pid}/fd"
    before = len(os.listdir(of_server))
    for _ in range(50):
        with server.connect(reads="shared") as tf:
            assert tf.reads == "shared" and mapped_regions() <= regions + 1
        del tf
    wait_until(lambda: mapped_regions() <= regions)
    wait_until(lambda: len(os.listdir("/proc/self/fd")) <= descriptors + 3)
    wait_until(lambda: len(os.listdir(of_server)) <= before + 3)
