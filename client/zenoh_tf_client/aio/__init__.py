"""The asynchronous client, for asyncio: `AsyncTransformClient` and what it returns.

The synchronous client is made from these files by `scripts/sync_client.py`, apart from `gate`, and
from `aio.session`, which sends requests on an event loop.

It may import all of the synchronous client, and runs what has no asynchronous form on threads.
"""
