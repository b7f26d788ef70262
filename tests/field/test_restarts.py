"""Servers of the field that were started again, and what is asked before their publishers are back:
eclipse-zenoh/zenoh#2767."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.conftest import StartServer, linux
from tests.processes.ports import free_endpoint
from tests.processes.router_process import RouterProcess
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import ConnectivityException, LookupException, StampedTransform, Transform
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import ServerStarting, ServerUnavailable
from zenoh_tf_client import AsyncTransformClient, Mirror, TransformClient, tf2
from zenoh_tf_client.session.mapped_tree import Mode

#: A start that lasts as long as any test, and one that is over at once.
STARTING = ("--limit", "startup_ms=600000")
STARTED = ("--limit", "startup_ms=1")

Reader = TransformClient | Mirror


def link(parent: str, child: str, stamp_ns: int = 1, x: float = 0.0) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0)))


@pytest.fixture(scope="module")
def starting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server that has just started for the whole module; it knows ``map`` and ``base``."""
    folder = tmp_path_factory.mktemp("starting")
    flags = (*STARTING, "--share-dir", str(folder))
    server = ServerProcess(folder / "log", free_endpoint(), "main", flags)
    with server.connect() as tf:
        tf.set_transform(link("map", "base"))
    yield server
    server.stop()


@pytest.fixture(params=["query", pytest.param("shared", marks=linux), "mirror"])
def reader(request: pytest.FixtureRequest, starting: ServerProcess) -> Iterator[Reader]:
    reads: Mode = "shared" if request.param == "shared" else "query"
    with ExitStack() as stack:
        tf = stack.enter_context(starting.connect(reads=reads))
        if request.param == "shared":
            assert tf.stats()["reads_shared"] == 1
        yield stack.enter_context(tf.mirror()) if request.param == "mirror" else tf


#: Everything that asks for a frame, by name.
ASK: dict[str, Callable[[Any, str], object]] = {
    "lookup": lambda tf, name: tf.lookup_transform("map", name),
    "at a stamp": lambda tf, name: tf.lookup_transform(name, "base", 1),
    "latest": lambda tf, name: tf.lookup_latest_transform("map", name),
    "full": lambda tf, name: tf.lookup_transform_full("map", 1, name, 1, "base"),
    "rows": lambda tf, name: tf.lookup_transforms("map", [name], None).raise_for_status(),
    "sample": lambda tf, name: tf.sample("map", name, [1]).raise_for_status(),
    "velocity": lambda tf, name: tf.lookup_velocity(name, "map"),
    "estimate": lambda tf, name: tf.estimate_transform("map", name),
    "frame": lambda tf, name: tf.frame(name),
    "parent": lambda tf, name: tf.parent(name),
    "chain": lambda tf, name: tf.chain("map", name),
    "common time": lambda tf, name: tf.latest_common_time("map", name),
}


def test_links_that_may_come_back(reader: Reader, starting: ServerProcess) -> None:
    """Of two publishers one is back already: both frames are there, and no path between them."""
    with starting.connect() as tf:
        tf.set_transform(link("mount", "camera"))
    if isinstance(reader, Mirror):
        reader.wait_for()
    with pytest.raises(ConnectivityException, match=r"server was started .* ago") as raised:
        reader.lookup_transform("map", "camera")
    assert raised.value.retry_after_s


@pytest.mark.parametrize("name", ["base_lnik", "rechter Arm é"])
@pytest.mark.parametrize("ask", ASK)
def test_a_frame_that_may_come_back_is_no_misspelt_one(reader: Reader, ask: str, name: str) -> None:
    with pytest.raises(ServerStarting) as raised:
        ASK[ask](reader, name)
    assert isinstance(raised.value, LookupException)  # existing handlers work
    if ask in ("rows", "sample"):  # whose rows have a status each
        return
    assert f"ago and has no frame {name!r} yet" in str(raised.value)
    assert "the server was started " in str(raised.value)
    assert (raised.value.frame, raised.value.retry_after_s) == (name, 0.1)


def test_known_frames_are_answered_as_always(reader: Reader) -> None:
    assert reader.lookup_transform("map", "base").stamp_ns == 1
    assert reader.can_transform("map", "arm") is False
    found = reader.explain("arm", "base")
    assert (found.possible, found.error) == (False, "ServerStarting")
    assert "The server was started " in str(found)
    assert "has no frame 'arm' yet" in str(found)


def test_batches_and_waits(starting: ServerProcess) -> None:
    with starting.connect() as tf:
        with tf.batch() as batch:
            known = batch.lookup_transform("map", "base")
            unknown = batch.lookup_transform("map", "gripper")
        assert known.result().stamp_ns == 1
        with pytest.raises(ServerStarting, match="has no frame 'gripper' yet"):
            unknown.result()
        with pytest.raises(ServerStarting, match=r"yet \(waited for \d+ ms\)"):
            tf.lookup_transform("map", "gripper", timeout_s=0.02)
        sender = threading.Timer(0.05, tf.set_transform, [link("base", "late", 1, 7.0)])
        sender.start()
        assert tf.lookup_transform("base", "late", timeout_s=20).transform.translation[0] == 7
        sender.join()


async def test_an_event_loop(starting: ServerProcess) -> None:
    async with await AsyncTransformClient.connect(starting.endpoint, reads="query") as tf:
        with pytest.raises(ServerStarting, match="no frame 'tool' yet"):
            await tf.lookup_transform("map", "tool")
        assert (await tf.explain("map", "tool")).error == "ServerStarting"
        with pytest.raises(ServerStarting):
            await tf.lookup_transform("map", "tool", timeout_s=0.02)


def test_a_tf2_buffer(starting: ServerProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENOH_TF_CONNECT", starting.endpoint)
    buffer = tf2.Buffer()
    try:
        with pytest.raises(tf2.LookupException, match="no frame 'lidar' yet"):
            buffer.lookup_transform("map", "lidar", tf2.Time())
        answer = buffer.can_transform("map", "lidar", tf2.Time(), return_debug_tuple=True)
        assert isinstance(answer, tuple)
        assert answer[0] is False
        assert "the server was started" in answer[1]
    finally:
        tf2.close()


def test_a_start_ends(start_server: StartServer) -> None:
    server = start_server(*STARTED)
    with server.connect() as tf, tf.mirror() as mirror:
        tf.set_transform(link("map", "base"))
        mirror.wait_for()
        for reader in (tf, mirror):
            with pytest.raises(LookupException, match="frame 'x' does not exist") as raised:
                reader.lookup_transform("map", "x")
            assert type(raised.value) is LookupException
            assert reader.explain("map", "x").error == "LookupException"


@pytest.mark.parametrize(
    ("reads", "names"),
    [("query", ("map", "base")), pytest.param("shared", ("w", "lidar 0"), marks=linux)],
)
def test_a_lookup_loop_over_a_restart(
    tmp_path: Path, start_server: StartServer, reads: Mode, names: tuple[str, str]
) -> None:
    """A broadcaster sends at 50 Hz; the server has no state, is killed and comes back."""
    endpoint, (parent, child) = free_endpoint(), names
    flags = ("--limit", "startup_ms=60000", "--share-dir", str(tmp_path))
    server = start_server(*flags, endpoint=endpoint)
    ended = threading.Event()

    def send(tf: TransformClient) -> None:
        with tf.broadcaster("sensor") as sensor:
            sensor.send_static(link(child, f"{child}/mount"))
            while not ended.wait(0.02):
                sensor.send(link(parent, child, time.time_ns()))

    with server.connect(20) as sender, server.connect(2, reads) as tf:
        thread = threading.Thread(target=send, args=(sender,))
        thread.start()
        try:
            target = f"{child}/mount"
            assert tf.can_transform(parent, target, timeout_s=20)
            server.kill()
            restart = threading.Thread(
                target=start_server, args=flags, kwargs={"endpoint": endpoint}
            )
            restart.start()
            seen: list[type[Exception]] = []
            instance = tf._connection.known_instance

            def is_back() -> bool:
                try:
                    tf.lookup_transform(parent, target)
                except (LookupException, ServerUnavailable) as error:
                    seen.append(type(error))
                    return False
                return tf.instance != instance

            wait_until(is_back)
            restart.join()
        finally:
            ended.set()
            thread.join()
    assert set(seen) <= {ServerStarting, ServerUnavailable}


@contextmanager
def running(router: RouterProcess) -> Iterator[RouterProcess]:
    try:
        yield router
    finally:
        router.kill()


def kill(server: ServerProcess, router: RouterProcess, tree: str) -> None:
    """Kill a server, and wait until the router knows: a query that it sends to a link that is
    breaking off may never end."""
    with zenoh.open(zenoh_config.client([router.endpoint], 10)) as session:
        served = session.declare_querier(keys.request(tree, "info"))
        wait_until(lambda: served.matching_status.matching)  # type: ignore[attr-defined]
        server.kill()
        wait_until(lambda: not served.matching_status.matching)  # type: ignore[attr-defined]


@pytest.mark.parametrize("tree", ["main", "site/robot 2"])
def test_a_query_that_ends_at_once_is_sent_again(
    start_server: StartServer, monkeypatch: pytest.MonkeyPatch, tree: str
) -> None:
    """The router is there, and what it leads to is not declared yet."""
    monkeypatch.setattr("zenoh_tf_client.session.retries.ABSENT_S", 100.0)
    home = start_server(tree="home")
    with running(RouterProcess(home.endpoint)) as router:
        flags = ("--connect", router.endpoint)
        server = start_server(*flags, endpoint=router.endpoint, tree=tree)
        with server.connect(100) as tf:
            tf.set_transform(link("map", "base"))
            kill(server, router, tree)
            again = {"endpoint": router.endpoint, "tree": tree}
            restart = threading.Thread(target=start_server, args=flags, kwargs=again)
            restart.start()
            assert tf.frames() == []  # of the next server
            restart.join()


def test_a_router_without_its_server_fails_soon(
    start_server: StartServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zenoh_tf_client.session.retries.ABSENT_S", 0.1)
    home = start_server(tree="home")
    with running(RouterProcess(home.endpoint)) as router:
        server = start_server("--connect", router.endpoint, endpoint=router.endpoint)
        with server.connect(10_000) as tf:
            kill(server, router, "main")
            for call in (tf.frames, lambda: tf.set_transform(link("map", "base"))):
                with pytest.raises(ServerUnavailable):  # long before its time-out
                    call()
