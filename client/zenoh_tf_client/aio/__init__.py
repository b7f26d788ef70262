"""The asynchronous client, for asyncio: `AsyncTransformClient` and what it returns.

From `lookups`, `sensor_data`, `writes`, `introspection`, `transaction` and `batch` the synchronous
client's files of the same names are made by `scripts/sync_client.py`. What differs more is written
by hand: `client`, `gate`, `mirror`, `watch`, `broadcaster`, and in `aio.session` what sends
requests on an event loop.

It may import all of the synchronous client, and runs what has no asynchronous form on threads.
"""
