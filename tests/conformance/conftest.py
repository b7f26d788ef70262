"""The tree under test: embedded, or a client of a live server. The tests are the same for all."""

from __future__ import annotations

import asyncio
import functools
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import pytest

from tests.processes.live_server import LiveServer, running_loop
from zenoh_tf import TransformTree
from zenoh_tf_server.process.sharing import SharingSettings
from zenoh_tf_server.settings import Concurrency

from .shorthand import MODES, Tree


@pytest.fixture(params=MODES)
def mode(request: pytest.FixtureRequest) -> str:
    """How the tree is reached. Tests about the network ask for `REMOTE`."""
    return str(request.param)


@pytest.fixture(scope="session")
def loop() -> Iterator[asyncio.AbstractEventLoop]:
    with running_loop() as loop:
        yield loop


StartLive = Callable[..., LiveServer]
MakeTree = Callable[..., Tree]


@pytest.fixture(scope="module")
def start_live(loop: asyncio.AbstractEventLoop) -> Iterator[StartLive]:
    """``start_live(mode, **settings)``: a server with the mode's concurrency control.

    It ends with the file, as each server has threads that poll."""
    with ExitStack() as servers:
        folder = Path(servers.enter_context(tempfile.TemporaryDirectory()))

        def start(mode: str, **settings: Any) -> LiveServer:
            reach, _, concurrency = mode.partition("-")
            # No predecessor can have had the endpoint.
            sharing = SharingSettings(folder, off=reach != "shared", predecessor_s=0.0)
            server = LiveServer(loop, cast(Concurrency, concurrency), sharing, **settings)
            servers.callback(server.stop)
            return server

        yield start


@pytest.fixture(scope="module")
def lend_live(start_live: StartLive) -> StartLive:
    """The same, of servers that tests share."""
    return functools.cache(start_live)


@pytest.fixture
def make_tf(
    request: pytest.FixtureRequest, mode: str, start_live: StartLive, lend_live: StartLive
) -> Iterator[MakeTree]:
    """``make_tf(cache_time_s=10.0, ...)``: an empty tree, which may take the place of the one
    before. Options: those that `TransformTree` and the server's `ServerSettings` have in common."""
    own = request.node.get_closest_marker("own_server") is not None
    lend = start_live if own else lend_live
    reach, _, concurrency = mode.partition("-")
    with ExitStack() as clients:

        def make(**options: Any) -> Tree:
            if reach == "embedded":
                return TransformTree(concurrency=cast(Concurrency, concurrency), **options)
            client = clients.enter_context(lend(mode, **options).connect())
            client.reset()
            return client

        yield make


@pytest.fixture
def tf(make_tf: MakeTree) -> Tree:
    """An empty tree that keeps ten seconds, as tf2's buffer does."""
    return make_tf()
