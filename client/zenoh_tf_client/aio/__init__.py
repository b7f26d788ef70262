"""The asynchronous client, for asyncio: `AsyncTransformClient` and what it returns.

`lookups.py`, `writes.py`, `introspection.py`, `transaction.py` and `batch.py` are made from the
synchronous client's files by `scripts/async_client.py`.
"""
