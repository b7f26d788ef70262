"""The asynchronous client, for asyncio: `AsyncTransformClient` and what it returns.

The synchronous client, and the library's `Gate`, are made from these files by
`scripts/sync_client.py`. `aio.session`, which sends requests on an event loop, is apart.

It may import all of the synchronous client, and runs what has no asynchronous form on threads.
"""
