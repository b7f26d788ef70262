"""Several endpoints: in the SDK, the commands and the environment; and what errors say of them."""

from __future__ import annotations

import asyncio
import json

import pytest

from tests.conftest import ServerProcess, StartServer
from tests.processes.ports import free_endpoint
from tests.processes.tcp_proxy import TcpProxy
from tests.support.command_line import run
from zenoh_tf._net import zenoh_config
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable
from zenoh_tf_client import AsyncTransformClient, TransformClient, tf2
from zenoh_tf_client.session import environment
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.process import network


def test_a_list_is_texts_or_one_text_with_commas() -> None:
    both = ("tcp/a:1", "tls/[::1]:2#file=/etc/a,b")
    for given in (both, list(both), ", ".join(both), [",".join(both)], [*both, both[0]]):
        assert zenoh_config.endpoints_of(given) == both
    assert zenoh_config.addresses(both) == "tcp/a:1 or tls/[::1]:2"


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ([], "no endpoint"),
        ("", "no protocol"),
        ("tcp/a:1,", "port"),
        (["tcp/a:1", "b:2"], "no protocol"),
        ("tcp/a:1,http/b:2", "unknown protocol 'http'"),
        ([f"tcp/a:{port}" for port in range(17)], "17 endpoints: the limit is 16"),
    ],
)
def test_a_wrong_list(given: str | list[str], reason: str) -> None:
    for connect in (zenoh_config.endpoints_of, TransformClient.connect):
        with pytest.raises(InvalidArgumentException, match=reason) as refusal:
            connect(given)
        assert refusal.value.field == "endpoint"


def test_a_client_connects_to_the_first_that_answers(server: ServerProcess) -> None:
    nobody = free_endpoint()
    with TransformClient.connect([nobody, server.endpoint]) as tf:
        assert tf.frames() == []
        assert tf.endpoint == server.endpoint
        assert server.endpoint in repr(tf)
    with TransformClient.connect(f"{server.endpoint},{nobody}") as tf:
        assert tf.endpoint == server.endpoint

    async def connect() -> None:
        async with await AsyncTransformClient.connect([nobody, server.endpoint]) as tf:
            assert await tf.frames() == []
            assert (tf.endpoint, tf.reads) == (server.endpoint, "query")

    asyncio.run(connect())


def test_one_that_accepts_connections_and_says_nothing(server: ServerProcess) -> None:
    with TcpProxy(server.endpoint) as silent:
        silent.hold()
        with TransformClient.connect([silent.endpoint, server.endpoint]) as tf:
            assert (tf.endpoint, tf.frames()) == (server.endpoint, [])
        silent.release()


def test_commands_and_their_environment(
    server: ServerProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    nobody = free_endpoint()
    lists: list[list[str]] = [
        ["--connect", nobody, "--connect", server.endpoint, "frames", "--json"],
        ["frames", "--json", "--connect", f"{nobody},{server.endpoint}"],
    ]
    for arguments in lists:
        done = run(*arguments)
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["frames"] == []
    monkeypatch.setenv(environment.ENDPOINT_VARIABLE, f"{nobody}, {server.endpoint}")
    assert run("frames", "--json").returncode == 0
    tf2.connect()
    try:
        assert tf2.connect([nobody, server.endpoint]).endpoint == server.endpoint
        with pytest.raises(InvalidArgumentException, match="this process is connected"):
            tf2.connect(server.endpoint)
    finally:
        tf2.close()


def test_an_error_says_of_each_why(start_server: StartServer) -> None:
    nobody = free_endpoint()
    stopped = start_server()
    stopped.freeze()
    with pytest.raises(ServerUnavailable) as refusal:
        TransformClient.connect([nobody, stopped.endpoint], timeout_s=0.5)
    assert str(refusal.value) == (
        f"none of 2 endpoints can be reached: nothing listens at {nobody} (tree 'main', tried for "
        f"0.5 s); {stopped.endpoint} accepts connections, but answers nothing within 2 s: the "
        "server is stopped or overloaded, or is no zenoh-tf-server"
    )


def test_a_server_joins_the_first_router_that_answers(
    server: ServerProcess, start_server: StartServer
) -> None:
    nobody = free_endpoint()
    start_server("--connect", nobody, "--connect", server.endpoint, tree="joined")
    with TransformClient.connect(server.endpoint, "joined") as tf:
        assert tf.frames() == []


def test_a_server_waits_for_routers_that_are_starting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "CONNECT_TIMEOUT_S", 0.2)
    both = [free_endpoint(), free_endpoint()]
    with pytest.raises(network.NetworkError, match=f"cannot connect to {', '.join(both)} within"):
        network.open_session([], both, Limits())
