"""Broadcasters announce static transforms to new servers, and never undo a correction."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from tests.conftest import StartServer
from tests.processes.live_server import limited
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.processes.tcp_proxy import TcpProxy
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf._net import keys
from zenoh_tf_client import Broadcaster, TransformClient
from zenoh_tf_client.publish.announcer import Announcer
from zenoh_tf_client.publish.publisher import message
from zenoh_tf_client.session.server_info import ServerInfo

DEADLINE_S = 30


class ShortLease(ServerProcess):
    """A server whose clients miss it after a second, not after ten."""

    START = (
        "-c",
        "import sys; from zenoh_tf._net import zenoh_config\n"
        "zenoh_config._COMMON['transport/link/tx/lease'] = 1000\n"
        "from zenoh_tf_server.main import main; sys.exit(main())",
    )


@pytest.fixture
def frozen_soon(tmp_path: Path) -> Iterator[ServerProcess]:
    server = ShortLease(tmp_path / "log", free_endpoint(), "main", ())
    yield server
    server.stop()


@pytest.fixture
def start(start_server: StartServer, tmp_path: Path) -> Callable[..., ServerProcess]:
    """``start(*flags)``: a server on one endpoint and folder."""
    endpoint, folder = free_endpoint(), str(tmp_path / "state")
    return lambda *flags: start_server("--state-dir", folder, *flags, endpoint=endpoint)


def link(parent: str, child: str, x: float = 0.0) -> StampedTransform:
    return StampedTransform(parent, child, 0, Transform((x, 0, 0)))


def x_of(tf: TransformClient, child: str) -> float:
    return float(tf.lookup_transform("base", child).transform.translation[0])


def announcer_of(broadcaster: Broadcaster) -> Announcer:
    assert broadcaster._announcer is not None
    return broadcaster._announcer


def until_informed(broadcaster: Broadcaster, server: ServerProcess) -> None:
    """Wait until the broadcaster has announced its statics to this server instance."""
    wait_until(lambda: (announcer_of(broadcaster)._informed or "?") in server.greeting)


@pytest.mark.parametrize("may_be_lost", [False, True])
def test_a_reconnect_to_the_same_server(
    frozen_soon: ServerProcess, monkeypatch: pytest.MonkeyPatch, may_be_lost: bool
) -> None:
    """What may not have arrived is announced again, which changes no correction."""
    server = frozen_soon
    if not may_be_lost:
        monkeypatch.setattr("zenoh_tf_client.publish.announcer._MAY_BE_LOST_S", 0.0)
    with server.connect() as tf, tf.broadcaster("urdf") as urdf:
        urdf.send_static([link("base", "camera", 1), link("base", "lidar", 1)])
        assert tf.can_transform("camera", "lidar", timeout_s=10)
        tf.set_transform(link("base", "camera", 2), authority="urdf", static=True)
        tf.remove_frame("lidar")
        puts = tf.stats()["puts"]
        announcer = announcer_of(urdf)
        wait_until(lambda: announcer._present)
        server.freeze()
        wait_until(lambda: not announcer._present)
        server.send_signal(signal.SIGCONT)
        wait_until(lambda: announcer._present)
        announcer.check()
        wait_until(lambda: not announcer._may_be_new)
        urdf.send_static(link("base", "radar", 3))
        assert tf.can_transform("base", "radar", timeout_s=10)
        assert sorted(tf.frames()) == ["base", "camera", "radar"]
        assert x_of(tf, "camera") == 2
        assert may_be_lost or tf.stats()["puts"] == puts + 1


def test_statics_sent_while_no_server_is_there(start: Callable[..., ServerProcess]) -> None:
    server = start()
    with server.connect(20) as tf, tf.broadcaster("urdf") as urdf:
        urdf.send_static([link("base", "camera", 1), link("base", "lidar", 1)])
        assert tf.can_transform("camera", "lidar", timeout_s=10)
        for child in ("camera", "lidar"):
            tf.set_transform(link("base", child, 2), authority="operator", static=True)
        server.kill()
        wait_until(lambda: urdf._announcer and not urdf._announcer._present)
        urdf.send_static(link("base", "camera", 3))  # newer than the correction
        server = start()
        until_informed(urdf, server)
        wait_until(lambda: x_of(tf, "camera") == 3)
        assert x_of(tf, "lidar") == 2


def test_a_correction_survives_a_restart(start: Callable[..., ServerProcess]) -> None:
    server = start()
    with server.connect(20) as tf, tf.broadcaster("urdf") as urdf:
        names = ["camera", "lidar", "radar", "imu", "own"]
        urdf.send_static([link("base", name, 1) for name in names])
        assert tf.can_transform("base", "own", timeout_s=10)
        tf.set_transform(link("base", "camera", 2), authority="operator", static=True)
        tf.set_transform(link("base", "imu", 2), authority="urdf", static=True)
        tf.remove_frame("lidar")
        tf.set_transform(link("base", "radar", 2), authority="slam")
        for _ in range(2):
            server.kill()
            server = start()
            # As if the sensor had not come back before these.
            until_informed(urdf, server)
            wait_until(lambda: tf.stats()["puts"] == 1)
            assert sorted(tf.frames()) == ["base", "camera", "imu", "own", "radar"]
            assert (x_of(tf, "camera"), tf.frame("camera").authority) == (2, "operator")
            assert (x_of(tf, "imu"), tf.frame("imu").authority) == (2, "urdf")
            assert x_of(tf, "own") == 1
            assert "statics of 'urdf': announced again, but 3 left out" in server.log
            tf.set_transform(link("base", "radar", 2), authority="slam")
        tf.reset()  # as new: the next server accepts all
        server.kill()
        server = start()
        until_informed(urdf, server)
        wait_until(lambda: len(tf.frames()) == 6)


class Servers(set[str]):
    """The servers that an announcer sees, and whether one has gone, if only for a moment."""

    has_lost_one = False

    def discard(self, instance: object, /) -> None:
        self.has_lost_one = True
        super().discard(cast(Any, instance))


@pytest.mark.parametrize("is_new", [False, True], ids=["may be lost", "not sent yet"])
@pytest.mark.parametrize("sends_another", [False, True])
def test_a_connection_that_breaks_while_statics_are_sent_again(
    server: ServerProcess,
    client: TransformClient,
    monkeypatch: pytest.MonkeyPatch,
    is_new: bool,
    sends_another: bool,
) -> None:
    """The reply over the next connection proves nothing, and what another thread sends meanwhile
    does not hide that the connection broke."""
    swallowed: list[bytes] = []
    with (
        TcpProxy(server.endpoint) as proxy,
        TransformClient.connect(proxy.endpoint, timeout_s=5.0, reads="query") as tf,
        tf.broadcaster("urdf") as urdf,
    ):
        urdf.send_static(link("base", "camera", 1))
        announcer = announcer_of(urdf)
        wait_until(lambda: announcer._present and "camera" in client.frames())
        send_again = announcer._send_again
        announcer._present = servers = Servers(announcer._present)
        # As if it had been sent over a connection that broke, or while there was none.
        with announcer._lock:
            announcer._statics["lidar"] = link("base", "lidar", 7)
            (announcer._unsent if is_new else announcer._may_be_lost).add("lidar")

            def is_back() -> bool:
                with announcer._lock:
                    announcer._read_reports()
                    return servers.has_lost_one and bool(servers)

            def lose(frames: list[str], server: ServerInfo, *, announce: bool) -> None:
                if swallowed or "lidar" not in frames:
                    send_again(frames, server, announce=announce)
                    return
                with monkeypatch.context() as patch:
                    patch.setattr(announcer._publisher, "put", swallowed.append)
                    send_again(frames, server, announce=announce)
                proxy.reset()
                wait_until(is_back, "the broken connection is not reported")
                if sends_another:
                    urdf.send_static(link("base", "radar", 2))

            monkeypatch.setattr(announcer, "_send_again", lose)
        wait_until(lambda: "lidar" in client.frames(), "it is lost")
        assert len(swallowed) == 1
        assert x_of(client, "lidar") == 7
        wait_until(lambda: not announcer._unsent and not announcer._may_be_lost)


def test_many_statics_and_small_limits(start_server: StartServer) -> None:
    endpoint = free_endpoint()
    server = start_server(endpoint=endpoint)
    with server.connect(20) as tf, tf.broadcaster("urdf") as urdf:
        urdf.send_static([link("base", f"{'x' * 100} {number}") for number in range(500)])
        assert tf.can_transform("base", f"{'x' * 100} 499", timeout_s=10)
        server.kill()
        flags = ("--limit", "rows=50", "--limit", "message_bytes=4096")
        server = start_server(*flags, endpoint=endpoint)
        until_informed(urdf, server)
        wait_until(lambda: len(tf.frames()) == 501)
        assert tf.stats()["bad_puts"] == 0


def test_an_error_does_not_end_announcing(
    start_server: StartServer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    server = start_server()
    with server.connect(20) as tf, tf.broadcaster("urdf") as urdf:
        urdf.send_static(link("base", "camera", 1))
        announcer = announcer_of(urdf)
        failures = iter([ValueError("one"), OSError("two")])
        send = announcer._send_to_server

        def fail_twice() -> bool:
            for error in failures:
                raise error
            return send()

        monkeypatch.setattr(announcer, "_send_to_server", fail_twice)
        server.kill()
        server = start_server(endpoint=server.endpoint)
        until_informed(urdf, server)
        assert tf.can_transform("base", "camera", timeout_s=10)
        for error in ("ValueError: one", "OSError: two"):
            assert error in caplog.text


def test_closed_broadcasters_are_let_go(client: TransformClient) -> None:
    with client.broadcaster("a") as a:
        a.send_static(link("base", "a"))
        b = client.broadcaster("b")
        assert client._broadcasters == {a, b}
    assert client._broadcasters == {b}
    b.close()
    b.close()
    assert client._broadcasters == set()


def test_which_announcements_are_applied(server: ServerProcess, client: TransformClient) -> None:
    tf = client

    def put(*rows: StampedTransform, announce: bool = True) -> None:
        """Put an announcement, or new transforms, and wait until the server has it."""
        puts = sum(tf.stats()[name] for name in ("puts", "bad_puts"))
        key = keys.put("main", "urdf", static=True)
        tf._connection.session.put(key, message(rows, announce=announce))
        wait_until(lambda: sum(tf.stats()[name] for name in ("puts", "bad_puts")) == puts + 1)

    put(link("base", "own", 1))
    tf.set_transform(link("base", "corrected", 1), authority="urdf", static=True)
    tf.set_transform(link("base", "other", 1), authority="operator", static=True)
    tf.set_transform(link("base", "dynamic", 1), authority="urdf")
    tf.set_transforms_xact([link("base", "gone", 1), link("gone", "below", 1)], static=True)
    tf.remove_frame("gone", subtree=True)
    names = ["own", "corrected", "other", "dynamic", "gone", "below", "new"]
    put(*[link("base", name, 2) for name in names])
    assert {name: x_of(tf, name) for name in names if name in tf.frames()} == {
        "own": 2,
        "corrected": 1,
        "other": 1,
        "dynamic": 1,
        "new": 2,
    }
    assert not tf.frame("dynamic").static
    assert "announced again, but 5 left out, 'corrected' first" in server.log

    # A new transform ends a removal and a correction; a link that is cleared is removed.
    put(link("base", "gone", 3), link("base", "corrected", 3), announce=False)
    put(link("base", "gone", 4), link("base", "corrected", 4))
    assert (x_of(tf, "gone"), x_of(tf, "corrected")) == (4, 4)
    tf.clear(keep_static=False)
    put(link("base", "gone", 5), link("base", "newer", 5))
    assert tf.can_transform("base", "newer")
    assert not tf.can_transform("base", "gone")

    # One link that is refused keeps no other back.
    put(link("newer", "base", 6), link("base", "newest", 6), link("base", "newer", 7))
    assert (x_of(tf, "newest"), x_of(tf, "newer")) == (6, 7)
    assert "put of 'urdf': frame 'base': " in server.log
    assert "the link would close a cycle" in server.log


@pytest.mark.parametrize("order", [("old", "new"), ("new", "old")])
def test_of_two_announcements_the_newest_stamp_counts(
    client: TransformClient, order: tuple[str, str]
) -> None:
    """Two broadcasters of one link announce to a new server in any order. What the older one sends
    then is newer, and a later announcement of the other one does not undo it."""
    tf = client
    stamps = {"old": 5, "new": 6}

    def put(authority: str, *, announce: bool) -> None:
        rows = [
            StampedTransform("base", "arm", stamps[authority], Transform((stamps[authority], 0, 0)))
        ]
        puts = tf.stats()["puts"]
        key = keys.put("main", authority, static=True)
        tf._connection.session.put(key, message(rows, announce=announce))
        wait_until(lambda: tf.stats()["puts"] == puts + 1)

    for authority in order:
        put(authority, announce=True)
    assert (x_of(tf, "arm"), tf.frame("arm").authority) == (6, "new")
    put("old", announce=False)
    put("new", announce=True)
    assert (x_of(tf, "arm"), tf.frame("arm").authority) == (5, "old")


def test_removals_are_forgotten_at_the_limit() -> None:
    with limited(removed_statics=2) as server, server.connect() as tf:
        names = ["a", "b", "c"]
        for name in names:
            tf.set_transform(link("base", name), static=True)
            tf.remove_frame(name)
        rows = [link("base", name) for name in names]
        tf._connection.session.put(
            keys.put("main", "urdf", static=True), message(rows, announce=True)
        )
        assert tf.can_transform("base", "a", timeout_s=10)
        assert sorted(tf.frames()) == ["a", "base"]
