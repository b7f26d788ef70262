"""The names and sentences in which the synchronous client differs; see `sync_client.py`."""

from __future__ import annotations

#: By module of `aio/` the synchronous module, from which it is made.
FILES = {
    **{name: name for name in ("lookups", "sensor_data", "writes", "introspection")},
    **{name: name for name in ("transaction", "batch")},
    "broadcaster": "publish/broadcaster",
    "mirror": "mirror/mirror",
    "watch": "mirror/watch",
    "mirror_transaction": "mirror/transaction",
}
#: Modules that are written for each client: by asynchronous module the synchronous one.
MODULES = {"aio.gate": "zenoh_tf.gate"}
#: Every other name loses its "Async".
NAMES = {
    "__aenter__": "__enter__",
    "__aexit__": "__exit__",
    "__aiter__": "__iter__",
}
#: Functions that wait.
CALLS = {
    "asyncio.sleep": "time.sleep",
    "connection.opened": "connection",  # what calls of a thread use
}
#: What they make a thread call, the synchronous client calls itself.
IN_THREAD = ("in_thread", "self._connection.run")
#: Anywhere in docstrings, comments and messages.
SENTENCES = {
    "A coroutine function that reads": "Reads",
    "in an ``async with`` block": "in a ``with`` block",
    "`zenoh_tf.Dropped`. On the event loop.": (
        "`zenoh_tf.Dropped`. On a thread of the gate, or of the caller of `put` or `close`."
    ),
    "Concurrency: one task at a time": "Thread safety: one thread at a time",
}
#: By file, each there once.
OWN_SENTENCES = {
    "watch": {
        "An asynchronous context manager": "A context manager",
        """\
    Concurrency: all methods, from any task of the client's event loop. Each event goes to one of
    the tasks that wait.
""": """\
    Thread safety: all methods. Each event goes to one of the threads that wait.
""",
    },
    "mirror": {
        """\
    Its lookups are as fast as those of an embedded tree, and send no message. They are
    coroutines only with a `max_age_s`, as the server may be asked. The others answer from memory,
    without suspending the caller; a `timeout_s` would block the event loop. What they read is
    always""": """\
    Its lookups are as fast as those of an embedded tree, and send no message. What they read is
    always""",
        "An asynchronous context manager, which closes itself at\n    the end.": (
            "A context manager, which closes itself at the end."
        ),
        """\
    Concurrency: lookups and properties, from any thread; coroutines, from the client's event loop.
""": """\
    Thread safety: all methods.
""",
    },
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
