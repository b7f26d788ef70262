"""The names and sentences in which the synchronous client differs; see `sync_client.py`."""

from __future__ import annotations

#: By module of `aio/` the synchronous module, from which it is made.
FILES = {
    **{name: name for name in ("lookups", "sensor_data", "writes", "introspection")},
    **{name: name for name in ("transaction", "batch")},
    "broadcaster": "publish/broadcaster",
}
#: Modules that are written for each client: by asynchronous module the synchronous one.
MODULES: dict[str, str] = {}
#: Every other name loses its "Async".
NAMES = {
    "__aenter__": "__enter__",
    "__aexit__": "__exit__",
}
#: Functions that wait.
CALLS = {
    "asyncio.sleep": "time.sleep",
    "connection.opened": "connection",  # what calls of a thread use
}
#: What they make a thread call, the synchronous client calls itself.
IN_THREAD = ("self._connection.run",)
#: Anywhere in docstrings, comments and messages.
SENTENCES = {
    "Concurrency: one task at a time": "Thread safety: one thread at a time",
}
#: By file, each there once.
OWN_SENTENCES = {
    "broadcaster": {
        """\
    or removed since. Messages are sent in the order of the calls, by a thread: a sensor that
    outruns the network waits, and the event loop goes on. An asynchronous context manager, which
    closes itself at the end.

    Concurrency: all methods, from any task of the client's event loop.
""": """\
    or removed since. A context manager, which closes itself at the end.

    Thread safety: all methods.
""",
    },
}
