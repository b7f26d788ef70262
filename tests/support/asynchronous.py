"""What the tests of the asynchronous client share."""

from __future__ import annotations

import asyncio
from typing import Any

from tests.client.test_client import LINKS
from tests.processes.servers import ServerProcess
from zenoh_tf_client import AsyncTransformClient
from zenoh_tf_client.aio.session.connection import MAX_CALLS, MAX_WAITING_LOOKUPS


async def connected(server: ServerProcess, timeout_s: float = 10.0) -> AsyncTransformClient:
    """A client whose lookups are queries."""
    return await AsyncTransformClient.connect(
        server.endpoint, server.tree, timeout_s, reads="query"
    )


async def fill(tf: AsyncTransformClient) -> None:
    for stamped in LINKS:
        await tf.set_transform(stamped)


def sent_by(tf: AsyncTransformClient) -> list[str]:
    """The types of the requests that the client sends from now on."""
    request_types: list[str] = []
    queries = tf._connection.opened.queries
    send = queries.send

    def noted(key: Any, *arguments: Any) -> None:
        request_types.append(str(key).split("/")[-1])
        send(key, *arguments)

    queries.send = noted  # type: ignore[method-assign, assignment]
    return request_types


async def idle(tf: AsyncTransformClient) -> None:
    """Nothing is left of cancelled calls, neither here nor at the server."""
    await asyncio.sleep(0)
    assert_idle(tf)
    while (await tf.stats())["waiters"]:
        await asyncio.sleep(0.01)
    assert_idle(tf)


def assert_idle(tf: AsyncTransformClient) -> None:
    """Nothing is left of any call."""
    connection = tf._connection
    assert len(connection._outbox) == 0
    assert connection._room._value == MAX_CALLS
    assert connection._waiting_room._value == MAX_WAITING_LOOKUPS
