"""The server as a process: start, greeting, refusal to start, stop, kill and restart."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress

import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess, refused
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf._net import zenoh_config
from zenoh_tf.errors import (
    InvalidArgumentException,
    OutcomeUnknown,
    ServerRestarted,
    ServerUnavailable,
    TransformException,
)
from zenoh_tf_client import TransformClient
from zenoh_tf_server import flags

LINK = StampedTransform("map", "base", 1, Transform())
#: So many calls are beyond a test's time-out if each takes Zenoh's 10 s instead of its own time.
UNTIL_TIMEOUT = 7


@pytest.fixture
def flag_error(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """``flag_error(*flags)``: the message of a server whose flags are wrong."""

    def parse(*arguments: str) -> str:
        with pytest.raises(SystemExit) as caught:
            flags.parse(arguments)
        assert caught.value.code == 2
        usage, error = capsys.readouterr().err.splitlines()
        assert "--help" in usage
        return error

    return parse


def test_greeting_says_where_and_how(start_server: StartServer) -> None:
    server = start_server(tree="my tree")
    assert server.endpoint in server.greeting
    assert f"zenoh-tf --connect {server.endpoint} --tree 'my tree' frames" in server.greeting


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_stop_it_cleanly(server: ServerProcess, number: signal.Signals) -> None:
    with server.connect() as tf:
        tf.set_transform(LINK)
        failures: list[TransformException] = []

        def wait() -> None:
            with pytest.raises(ServerUnavailable) as caught:
                tf.lookup_transform("a", "b", timeout_s=30.0)
            failures.append(caught.value)

        waiting = threading.Thread(target=wait)
        waiting.start()
        while tf.stats()["waiters"] < 1:
            time.sleep(0.01)
        server.send_signal(number)
        assert server.process.wait(10) == 0  # the lookup would wait for longer
        waiting.join()
        assert "stopping" in str(failures[0])
    assert "Traceback" not in server.log


#: A put of 1 MB, as often as the network accepts it.
FLOOD = """
import sys
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient
sensor = TransformClient.connect(sys.argv[1]).broadcaster(f"flood {sys.argv[2]}")
rows = [StampedTransform("a", f"b{row}", 1, Transform()) for row in range(10_000)]
print("ready", flush=True)
while True:
    sensor.send(rows)
"""


def test_sigterm_under_a_flood_of_large_puts(server: ServerProcess) -> None:
    with ExitStack() as stack:
        for number in range(3):
            flood = stack.enter_context(
                forks.Popen(
                    [sys.executable, "-c", FLOOD, server.endpoint, str(number)],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                )
            )
            stack.callback(flood.kill)
            assert flood.stdout is not None
            assert flood.stdout.readline() == "ready\n"
        time.sleep(0.5)
        server.send_signal(signal.SIGTERM)
        assert server.process.wait(15) == 0
    assert "stopping" in server.log


def test_port_in_use(server: ServerProcess) -> None:
    line = refused("--listen", server.endpoint, "--tree", "other")
    assert line.splitlines()[-1] == (
        f"zenoh-tf-server: cannot listen on {server.endpoint}: the port is already in use"
    )


@pytest.mark.parametrize("flag", ["--listen", "--connect"])
@pytest.mark.parametrize("endpoint", ["foo", "tcp/127.0.0.1:http", "bogus/x#key=secret"])
def test_wrong_endpoints_are_said_in_our_words(
    flag_error: Callable[..., str], flag: str, endpoint: str
) -> None:
    line = flag_error(flag, endpoint)
    shown = endpoint.partition("#")[0]
    assert line.startswith(f"zenoh-tf-server: error: {flag}: endpoint '{shown}' has ")
    for internal in ("secret", ".rs", "src/", "Invalid", "locator"):
        assert internal not in line


def test_the_greeting_shows_no_options_of_an_endpoint(start_server: StartServer) -> None:
    """With TLS the options name the private key's file."""
    endpoint = free_endpoint()
    server = start_server(endpoint=f"{endpoint}#listen_private_key=/home/me/key.pem")
    assert f"listens on {endpoint};" in server.greeting
    assert f"--connect {endpoint} --tree" in server.greeting
    assert "key" not in server.greeting


def test_second_server_on_a_tree_is_refused(start_server: StartServer) -> None:
    first = start_server()
    line = refused("--connect", first.endpoint).splitlines()[-1]
    with first.connect() as tf:
        assert (
            f"tree 'main' is already served on this network by server instance {tf.instance}"
            in line
        )
        other = start_server("--connect", first.endpoint, tree="other", endpoint=first.endpoint)
        with other.connect() as there:
            there.set_transform(LINK)
            assert there.frames() and not tf.frames()
            assert there.instance != tf.instance


def test_of_two_servers_at_once_one_stays() -> None:
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "zenoh_tf_server", "--connect", endpoint]
    with zenoh.open(zenoh_config.router([endpoint])):
        servers = [
            forks.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) for _ in range(3)
        ]
        try:
            with TransformClient.connect(endpoint, timeout_s=20.0) as tf:
                wait_until(lambda: sum(server.poll() is None for server in servers) <= 1)
                assert sorted(server.poll() or 0 for server in servers) == [0, 2, 2]
                assert tf.set_transform(LINK)
        finally:
            for server in servers:
                server.terminate()
            for server in servers:
                server.communicate(timeout=10)


def test_no_server_at_all() -> None:
    endpoint = free_endpoint()
    for _ in range(UNTIL_TIMEOUT):
        with pytest.raises(ServerUnavailable) as caught:
            TransformClient.connect(endpoint, tree="lost", timeout_s=0.1)
    assert endpoint in str(caught.value) and "'lost'" in str(caught.value)
    with pytest.raises(InvalidArgumentException) as wrong:
        TransformClient.connect("bogus/x")
    assert wrong.value.field == "endpoint"


def test_another_tree(server: ServerProcess) -> None:
    for _ in range(UNTIL_TIMEOUT):
        with pytest.raises(ServerUnavailable) as caught:
            TransformClient.connect(server.endpoint, tree="lost", timeout_s=0.1)
    assert server.endpoint in str(caught.value) and "'lost'" in str(caught.value)


def test_a_wrong_tree_says_which_trees_there_are(start_server: StartServer) -> None:
    """After a second, not after the whole time-out, which is far beyond this test's own."""
    first = start_server(tree="main")
    with pytest.raises(ServerUnavailable) as caught:
        TransformClient.connect(first.endpoint, tree="mian", timeout_s=400.0)
    assert str(caught.value) == (
        f"no server for tree 'mian' at {first.endpoint}; trees served there: 'main'"
    )
    start_server("--connect", first.endpoint, tree="robot 2/arm", endpoint=first.endpoint)
    for timeout_s in (20.0, 0.8):  # also if the time is over before the first second
        with pytest.raises(ServerUnavailable) as caught:
            TransformClient.connect(first.endpoint, tree="mian", timeout_s=timeout_s)
        assert str(caught.value).endswith("trees served there: 'main', 'robot 2/arm'")


def test_a_server_that_exists_but_does_not_answer_is_waited_for(start_server: StartServer) -> None:
    """Other trees are served too, but the server's token shows that the tree's name is right."""
    router = start_server(tree="main")
    slow = start_server("--connect", router.endpoint, tree="slow", endpoint=router.endpoint)
    slow.freeze()
    with pytest.raises(ServerUnavailable, match=r"did not answer within 2 s"):
        slow.connect(timeout_s=2.0)
    slow.send_signal(signal.SIGCONT)
    with slow.connect(20.0), ThreadPoolExecutor() as pool:
        slow.freeze()  # its token goes when its lease is over
        connecting = pool.submit(slow.connect, 20.0)
        time.sleep(1.5)
        assert not connecting.done()
        slow.send_signal(signal.SIGCONT)
        with connecting.result() as tf:
            assert tf.frames() == []


def test_client_may_come_before_the_server(start_server: StartServer) -> None:
    endpoint = free_endpoint()
    with ThreadPoolExecutor() as pool:
        connecting = pool.submit(TransformClient.connect, endpoint, "main", 20.0)
        time.sleep(0.2)
        start_server(endpoint=endpoint)
        with connecting.result() as tf:
            assert tf.frames() == []


@pytest.mark.usefixtures("either_client")
def test_kill_during_a_call_and_restart(start_server: StartServer) -> None:
    server = start_server()
    with server.connect(timeout_s=3.0) as tf, ThreadPoolExecutor() as pool:
        tf.set_transform(LINK)
        server.freeze()  # so that the server dies during the calls
        write = pool.submit(tf.set_transform, LINK)
        read = pool.submit(tf.lookup_transform, "map", "base")
        time.sleep(0.3)
        assert not write.done() and not read.done()
        server.kill()
        assert type(write.exception()) is OutcomeUnknown
        assert type(read.exception()) is ServerUnavailable
        # There is no server now, so a write is not even sent.
        for call in (lambda: tf.set_transform(LINK), lambda: tf.lookup_transform("map", "base")):
            with pytest.raises(ServerUnavailable):
                call()

        start_server(endpoint=server.endpoint)
        wait_for_frames(tf, [])
        assert tf.set_transform(LINK)
        assert tf.lookup_transform("map", "base") == LINK


def wait_for_frames(tf: TransformClient, frames: list[str]) -> None:
    """Wait until there is a server, which has these frames."""

    def found() -> bool:
        with suppress(ServerUnavailable):
            return sorted(tf.frames()) == frames
        return False

    wait_until(found, str(frames))


def is_written(tf: TransformClient) -> bool:
    with suppress(OutcomeUnknown, ServerUnavailable):  # until this client has reconnected
        return tf.set_transform(LINK)
    return False


@pytest.mark.usefixtures("either_client")
def test_a_stopped_server_runs_no_write_that_was_given_up(server: ServerProcess) -> None:
    with server.connect(timeout_s=1.0) as tf, server.connect() as patient:
        assert tf.frames() == patient.frames() == []
        server.freeze()
        with pytest.raises(OutcomeUnknown, match=r"no answer from .* within 1 s"):
            tf.set_transform(LINK)
        with pytest.raises(ServerUnavailable, match=r"no answer from .* within"):
            tf.lookup_transform("map", "base")
        time.sleep(0.2)
        server.send_signal(signal.SIGCONT)
        assert patient.frames() == []
        time.sleep(0.1)
        assert patient.frames() == []
        wait_until(lambda: is_written(tf))


def test_transaction_over_a_restart(start_server: StartServer) -> None:
    server = start_server()
    with server.connect() as tf:
        tf.set_transform(LINK)
        reads_again, commits = tf.transaction(), tf.transaction()
        for tx in (reads_again, commits):
            tx.lookup_latest_transform_xact("map", "base")
        commits.set_transform(LINK)
        server.kill()
        start_server(endpoint=server.endpoint)
        wait_for_frames(tf, [])
        with pytest.raises(ServerRestarted, match=r"run .* transaction again$"):
            reads_again.can_transform("map", "base")
        with pytest.raises(ServerRestarted, match=r"run .* transaction again$"):
            commits.commit()
        assert tf.frames() == []


def test_a_write_finds_the_new_server_by_itself(start_server: StartServer) -> None:
    server = start_server()
    with server.connect() as tf, server.connect() as watcher:
        tf.set_transform(LINK)
        server.kill()
        start_server(endpoint=server.endpoint)
        wait_for_frames(watcher, [])
        wait_until(lambda: is_written(tf))
        assert sorted(watcher.frames()) == ["base", "map"]


def test_first_put_right_after_connect_arrives(server: ServerProcess) -> None:
    with server.connect() as watcher:
        for number in range(20):
            with server.connect() as tf, tf.broadcaster("sensor") as sensor:
                sensor.send(StampedTransform("map", f"frame{number}", 1, Transform()))
            assert watcher.can_transform("map", f"frame{number}", timeout_s=5.0), number
