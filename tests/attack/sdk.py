"""``python sdk.py NAME ENDPOINT``: asyncio programs that use the SDK as a user would.

They use its public interface only, and nothing of the tests, so that they run with the SDK of
another checkout.
"""

from __future__ import annotations

import asyncio
import functools
import itertools
import sys

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import AsyncTransformClient, TransformClient

client_of = functools.partial(TransformClient.connect, reads="query")


async def _asyncio_client(endpoint: str) -> AsyncTransformClient:
    tf = await AsyncTransformClient.connect(endpoint, timeout_s=20.0, reads="query")
    await tf.set_transform(StampedTransform("a", "b", 1, Transform()))
    print("ready", flush=True)
    await asyncio.to_thread(sys.stdin.readline)
    return tf


def asyncio_flood(endpoint: str) -> None:
    """Calls without end, 5,000 at once."""

    async def main() -> None:
        tf = await _asyncio_client(endpoint)
        while True:
            calls = [tf.lookup_transform("a", "b") for _ in range(4900)]
            sets = [
                tf.set_transform(StampedTransform("a", f"flood {index}", 1, Transform()))
                for index in range(100)
            ]
            await asyncio.gather(*calls, *sets, return_exceptions=True)

    asyncio.run(main())


def asyncio_cancels(endpoint: str) -> None:
    """Calls without end that are cancelled at any point of their way."""

    async def main() -> None:
        tf = await _asyncio_client(endpoint)
        for turn in itertools.count():
            tasks = [
                asyncio.create_task(call)
                for index in range(100)
                for call in (
                    tf.lookup_transform("a", "b"),
                    tf.lookup_transform("a", "never", timeout_s=600.0),
                    tf.lookup_transform("a", "never", timeout_s=600.0),
                    tf.frames(),
                    tf.set_transform(StampedTransform("a", f"cancel {index}", 1, Transform())),
                )
            ]
            await asyncio.sleep(turn % 20 * 0.002)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    asyncio.run(main())


if __name__ == "__main__":
    globals()[sys.argv[1]](*sys.argv[2:])
