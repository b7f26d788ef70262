"""The socket that hands a server's tree over: who may use it, and what it costs."""

from __future__ import annotations

import contextlib
import grp
import logging
import os
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess, refused
from tests.support.waiting import wait_until
from zenoh_tf import TransformTree, wire
from zenoh_tf._net import handover
from zenoh_tf.errors import ProtocolError
from zenoh_tf.shared_tree import RegionRefused, SharedTree
from zenoh_tf_client import TransformClient
from zenoh_tf_server.process.network import NetworkError
from zenoh_tf_server.process.sharing import Sharing, SharingSettings

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")


def path_of(folder: Path) -> str:
    [path] = folder.glob("*.sock")
    return str(path)


def open_descriptors(server: ServerProcess) -> int:
    return len(os.listdir(f"/proc/{server.process.pid}/fd"))


def reads_shared(server: ServerProcess) -> bool:
    with server.connect(reads="shared") as tf:
        return tf.reads == "shared"


def test_only_the_servers_user_may_open_it(start_sharing: StartServer, socket_folder: Path) -> None:
    server = start_sharing(tree="a/b ü")
    path = path_of(socket_folder)
    assert stat.S_IMODE(os.stat(path).st_mode) == 0o600
    with server.connect() as tf:
        assert Path(path).name == f"a_b__-{tf.instance}.sock"
    assert reads_shared(server)


def test_a_group_may_open_it(start_sharing: StartServer, socket_folder: Path) -> None:
    group = grp.getgrgid(os.getgid())
    start_sharing("--share-group", group.gr_name)
    status = os.stat(path_of(socket_folder))
    assert (stat.S_IMODE(status.st_mode), status.st_gid) == (0o660, group.gr_gid)


def test_servers_share_one_folder(start_sharing: StartServer, socket_folder: Path) -> None:
    """Servers that were killed leave sockets, which the next server removes."""
    running = start_sharing(tree="one")
    killed = [start_sharing(tree="two"), start_sharing(tree="one")]
    assert len(list(socket_folder.glob("*"))) == 3
    for server in killed:
        server.kill()
    assert len(list(socket_folder.glob("*"))) == 3
    last = start_sharing(tree="two")
    assert len(list(socket_folder.glob("*"))) == 2
    assert reads_shared(running) and reads_shared(last)
    assert last.stop() == running.stop() == 0
    assert list(socket_folder.glob("*")) == []


def test_only_sockets_of_this_users_servers_are_removed(socket_folder: Path) -> None:
    """Nobody listens on any of these."""
    names = ["main-0123456789abcdef", "main-0123456789abcdef-3", "other", "main-0123"]
    for name in names:
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(socket_folder / f"{name}.sock"))
    file = socket_folder / "main-1123456789abcdef.sock"
    file.write_text("no socket")
    if os.geteuid() == 0:
        names.append("main-2123456789abcdef")
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(socket_folder / f"{names[-1]}.sock"))
        os.chown(socket_folder / f"{names[-1]}.sock", 65534, -1)
    Sharing(SharingSettings(folder=socket_folder), "main", "one").close()
    left = {path.name for path in socket_folder.iterdir()}
    assert left == {f"{name}.sock" for name in names[2:]} | {file.name}


@pytest.mark.parametrize(("mode", "accepted"), [(0o777, False), (0o775, False), (0o1777, True)])
def test_a_folder_that_others_may_write_to_is_refused(
    socket_folder: Path, mode: int, accepted: bool
) -> None:
    folder = socket_folder / "open"
    folder.mkdir()
    folder.chmod(mode)
    inner = folder / "inner"  # others could rename it
    inner.mkdir(mode=0o700)
    for each in (folder, inner):
        if accepted:
            Sharing(SharingSettings(folder=each), "main", "one").close()
        else:
            with pytest.raises(NetworkError, match=r"others may write to .*: chmod go-w"):
                Sharing(SharingSettings(folder=each), "main", "one")


def test_a_client_refuses_the_socket_of_another_user(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    """Such as one that was put into a folder that had another mode when the server started."""
    if os.geteuid() != 0:
        pytest.skip("only root can become another user")
    server = start_sharing()
    path = path_of(socket_folder)
    socket_folder.chmod(0o1777)  # in a folder that the user may write to, the path is not trusted
    os.unlink(path)
    script = """
import os, socket, sys
os.setuid(65534)
with socket.socket(socket.AF_UNIX) as listener:
    listener.bind(sys.argv[1])
    listener.listen()
    print("listens", flush=True)
    sys.stdin.read()
"""
    with subprocess.Popen(
        [sys.executable, "-c", script, path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as impostor:
        assert impostor.stdout is not None
        assert impostor.stdout.readline() == "listens\n"
        with server.connect(reads="shared") as tf:
            assert tf.reads == "query"
            assert tf.stats()["reads_refused_not_trusted"] == 1
            assert not tf.can_transform("map", "base")
        impostor.kill()


def test_a_client_refuses_a_folder_that_others_may_write_to(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    server = start_sharing()
    socket_folder.chmod(0o777)
    with server.connect(reads="shared") as tf:
        assert tf.reads == "query" and tf.stats()["reads_refused_not_trusted"] == 1
    socket_folder.chmod(0o700)
    assert reads_shared(server)


def test_a_server_that_cannot_start_leaves_no_socket(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    server = start_sharing()
    flags = ("--share-dir", str(socket_folder), "--listen", server.endpoint)
    assert "already in use" in refused(*flags)
    assert len(list(socket_folder.glob("*"))) == 1


@pytest.mark.parametrize(
    ("flags", "error"),
    [
        (("--no-share", "--share-group", "root"), "exclude each other"),
        (("--connect", "tcp/127.0.0.1:1", "--share-dir", "/tmp"), "--connect does not share"),
        (("--share-dir", "/proc/none"), "cannot share the tree: No such file"),
        (("--share-dir", "/tmp" + 20 * "/../tmp"), "cannot share the tree: the path"),
        (("--share-group", "no such group"), "cannot share the tree"),
    ],
)
def test_what_was_asked_for_and_cannot_be_is_an_error(flags: tuple[str, ...], error: str) -> None:
    where = () if "--connect" in flags else ("--listen", free_endpoint())
    assert error in refused(*where, *flags)


def test_a_server_that_joined_a_network_is_asked(start_sharing: StartServer) -> None:
    router = start_sharing(tree="other")
    joined = ServerProcess(
        router._log.with_name("joined.log"),
        router.endpoint,
        "main",
        ("--connect", router.endpoint),
    )
    try:
        assert "the tree is not shared: the server joined a network" in joined.log
        assert not reads_shared(joined)
    finally:
        joined.stop()


def test_without_a_folder_the_tree_is_private(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(handover, "default_folders", lambda: [Path("/proc/none")])
    with caplog.at_level(logging.INFO, "zenoh_tf.server"):
        sharing = Sharing(SharingSettings(), "main", "one", joined=False)
        tree = sharing.make_tree(TransformTree)
    assert caplog.messages == [
        "the tree is not shared, clients read by queries: No such file or directory: /proc/none"
    ]
    assert tree._region_fd() == -1
    assert sharing.start(tree, {}) is None
    sharing.close()


def test_without_shared_memory_the_tree_is_private(
    socket_folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def make(**options: bool | str) -> TransformTree:
        if options:
            raise OSError(38, "memfd_create is not there")
        return TransformTree()

    monkeypatch.setattr(handover, "default_folders", lambda: [socket_folder])
    with caplog.at_level(logging.INFO, "zenoh_tf.server"):
        sharing = Sharing(SharingSettings(), "main", "one", joined=False)
        assert sharing.make_tree(make)._region_fd() == -1
    assert "memfd_create is not there" in caplog.text
    assert list(socket_folder.glob("*")) == []
    with pytest.raises(NetworkError, match="memfd_create is not there"):
        Sharing(SharingSettings(folder=socket_folder), "main", "one", joined=False).make_tree(make)


def test_clients_that_say_nothing_or_nonsense_cost_nothing(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    server = start_sharing()
    assert reads_shared(server)
    path = path_of(socket_folder)
    before = open_descriptors(server)
    silent = []
    for number in range(300):
        peer = socket.socket(socket.AF_UNIX)
        peer.connect(path)
        if number % 3:
            with contextlib.suppress(OSError):  # the server has closed the connection
                peer.sendall(os.urandom(100))
        silent.append(peer)
    for _ in range(3000):
        with socket.socket(socket.AF_UNIX) as peer:
            peer.connect(path)
    assert reads_shared(server)
    wait_until(lambda: open_descriptors(server) <= before + 3)
    for peer in silent:
        peer.close()
    assert reads_shared(server)


class Impostor:
    """A socket that sends what it likes."""

    def __init__(self, folder: Path, data: bytes, fds: list[int]) -> None:
        self.path = str(folder / "impostor.sock")
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self.path)
        self._listener.listen()
        self._data, self._fds = data, fds

    def receive(self) -> SharedTree:
        """What a client makes of it, which connects before the impostor sends."""

        def send() -> None:
            peer, _ = self._listener.accept()
            with peer:
                if self._fds:
                    socket.send_fds(peer, [self._data], self._fds)
                elif self._data:
                    peer.sendall(self._data)

        thread = threading.Thread(target=send)
        thread.start()
        try:
            return handover.receive(handover.Offer("", self.path), "main", "one", 20.0)
        finally:
            thread.join()
            self._listener.close()


@pytest.mark.parametrize(
    ("data", "descriptors", "error", "reason"),
    [
        (b"", 0, ConnectionResetError, "ended early"),
        (b"\x10\0\0\0abc", 0, ConnectionResetError, "ended early"),
        (b"HTTP/1.1 400", 0, RegionRefused, "not belong to a server"),
        (b"\1\0\0\0\x80", 0, RegionRefused, "0 file descriptors"),
        (b"\1\0\0\0\x80", 2, RegionRefused, "2 file descriptors"),
        (b"\1\0\0\0\xc1", 1, ProtocolError, "not a msgpack|malformed|cannot"),
        (b"\5\0\0\0\x81\xa1v\x01\xc0", 1, ProtocolError, "not a msgpack|malformed|cannot"),
        (b"\4\0\0\0\x81\xa1v\x01", 1, RegionRefused, "layout .unknown., and this client reads 3"),
        (handover.message("other", "one", {}), 1, RegionRefused, "another server"),
        (handover.message("main", "two", {}), 1, RegionRefused, "another server"),
        (handover.message("main", "one", {}), 1, RegionRefused, "sealed"),
    ],
)
def test_what_an_impostor_sends_is_refused(
    socket_folder: Path, data: bytes, descriptors: int, error: type[Exception], reason: str
) -> None:
    before = len(os.listdir("/proc/self/fd"))
    with open(os.devnull, "rb") as nothing:
        impostor = Impostor(socket_folder, data, [nothing.fileno()] * descriptors)
        with pytest.raises(error, match=reason):
            impostor.receive()
    assert len(os.listdir("/proc/self/fd")) == before


def test_nothing_comes_from_a_socket_that_is_silent(socket_folder: Path) -> None:
    path = str(socket_folder / "silent.sock")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen()
        with pytest.raises(TimeoutError):
            handover.receive(handover.Offer("", path), "main", "one", 0.1)


def test_hello_tells_where_the_socket_is(start_sharing: StartServer, socket_folder: Path) -> None:
    with start_sharing().connect() as tf:
        server = tf._connection.server
        assert server is not None
        assert server.offer == handover.Offer(handover.boot_id(), path_of(socket_folder))


@pytest.mark.parametrize("share", [None, 5, {}, {"host": "x"}, {"host": "x", "socket": "\0x"}])
def test_a_malformed_offer_is_none(share: object) -> None:
    assert handover.parse_offer(share) is None


def test_the_message_is_as_documented() -> None:
    data = handover.message("main", "one", {"rows": 5})
    offer = wire.unpack(data[4:])
    assert int.from_bytes(data[:4], "little") == len(data) - 4
    assert offer.keys() == {"v", "layout", "tree", "instance", "limits"}


def test_a_newer_servers_fields_are_ignored() -> None:
    offer = handover.parse_offer({"host": "h", "socket": "/s", "new": [1]})
    assert offer == handover.Offer("h", "/s")


def test_a_client_may_be_made_without_a_choice(server: ServerProcess) -> None:
    with server.connect() as first, TransformClient(first._connection) as tf:
        assert tf.reads == "shared"
