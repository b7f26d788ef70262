"""The names and sentences in which the synchronous client differs; see `sync_client.py`."""

from __future__ import annotations

#: By module of `aio/` the synchronous module, from which it is made.
FILES = {
    **{name: name for name in ("reads", "lookups", "writes")},
    **{name: name for name in ("introspection", "transaction", "batch")},
    "broadcaster": "publish/broadcaster",
    "mirror": "mirror/mirror",
    "watch": "mirror/watch",
    "mirror_transaction": "mirror/transaction",
    "client": "client",
    "gate": "../../zenoh_tf/gate",
    "session/shared_reads": "session/shared_reads",
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
    "self._connection.opened": "self._connection",
}
#: What they make a thread call, the synchronous client calls itself.
IN_THREAD = ("in_thread", "self._connection.run")
#: Anywhere in docstrings, comments and messages.
SENTENCES = {
    "An `Async": "A `",
    "A coroutine function that reads": "Reads",
    "in an ``async with`` block": "in a ``with`` block",
    "Concurrency: one task at a time": "Thread safety: one thread at a time",
}
#: By file, anything that is there once.
OWN_TEXTS = {
    "gate": {
        '"zenoh_tf.client"': '"zenoh_tf"',
        "a client or a mirror.": "a tree, a client or a mirror.",
        "`gate` of an asynchronous client or mirror.": "`gate` of a tree or a client.",
        """\
    Lookups wait in tasks, which end with the gate. An asynchronous context manager, which closes
    itself at the end.

    Concurrency: all methods, from any task of the client's event loop.
""": """\
    A context manager, which closes itself at the end.

    Thread safety: all methods.
""",
        "Use `AsyncTransformClient.gate` instead.": (
            "Use `TransformTree.gate` or `TransformClient.gate` instead."
        ),
        "; not a coroutine.": ".",
        "No event loop runs here.": "The system has no room for a thread.",
        "Let a task serve": "Let a thread serve",
        "another task does it": "another thread does it",
    },
    "client": {
        """\
    It has the methods of `TransformClient` as coroutines, with the same arguments, results and
    errors. Lookups, and sets of one authority, that are made in one turn of the event loop travel
    in one message. 4,000 calls and 2,000 waiting lookups may be under way; further callers wait
    for room. A cancelled call leaves nothing behind. If a write was sent before it was cancelled,
    the cause of the CancelledError is OutcomeUnknown. ``X_target_source`` maps coordinates in
    source to coordinates in target. Lengths are in metres, stamps in integer nanoseconds. After a
    lost connection the client reconnects by itself. An asynchronous context manager, which closes
    itself at the end.
""": """\
    It has the methods of `zenoh_tf.TransformTree`, with the same arguments, results and errors,
    and adds the errors of the service. ``X_target_source`` maps coordinates in source to
    coordinates in target. Lengths are in metres, stamps in integer nanoseconds. After a lost
    connection the client reconnects by itself. A context manager, which closes itself at the end.
    A process that is forked after the first connection cannot connect, and every call raises
    ServerUnavailable: start such processes with multiprocessing's "spawn" method.
""",
        """\
    Concurrency: all methods, from any task of the event loop that made the client. Any other loop
    gets RuntimeError, and needs a client of its own.
""": """\
    Thread safety: all methods.
""",
        """\
        ``"shared"``: from the server's memory, without suspending the caller. ``"query"``: by a
        query of the server, as long as its memory cannot be read. This changes by itself, for
        example when the server restarts; `stats` has the reasons, under names with ``reads_``.
""": """\
        ``"shared"``: from the server's memory, in well under a microsecond. ``"query"``: by a query
        of the server, as long as its memory cannot be read. This changes by itself, for example
        when the server restarts; `stats` has the reasons, under names with ``reads_``.
""",
        "def __init__(self, connection: Connection)": (
            'def __init__(self, connection: Connection, reads: Mode = "shared")'
        ),
        """\
            connection: The open connection to use.
""": """\
            connection: The open connection to use.
            reads: As in `connect`.
""",
        ", for asyncio; made by": "; made by",
        "use await ": "use ",
        "mapped_tree import Mode,": "mapped_tree import MappedTree, Mode,",
        "mapped = connection.mapped": "mapped = MappedTree(connection, reads)",
        "open client of the running event loop": "open client",
        "Calls of other tasks that wait for a reply fail at once.": (
            "Calls of other threads that wait for a reply fail soon."
        ),
        "; `on_drop` is called on the event loop. Not a coroutine.": ".",
        ": ``await tf.instance``.": ".",
        " Not a coroutine, as it only records.": "",
        """\
        Not a coroutine, as it does not ask the server.

""": "",
        "An `AsyncWatch`, for ``async with`` and ``async for``": "A `Watch`, for `with` and `for`",
    },
    "session/shared_reads": {
        " What is in memory is read without suspending the caller.": "",
        "Concurrency: all methods, from any task of the client's event loop.": (
            "Thread safety: all methods."
        ),
    },
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
    Its lookups are as fast as those of an embedded tree, and send no message. Those with a
    `timeout_s` or a `max_age_s` are coroutines, as they may wait or ask; a thread waits for them,
    not the event loop. The others are plain methods, which answer at once. What they read is
    always""": """\
    Its lookups are as fast as those of an embedded tree, and send no message. What they read is
    always""",
        'print(await m.lookup_transform("map", "base"))``': (
            'print(m.lookup_transform("map", "base"), m.age_s)``'
        ),
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
    outruns the network waits, not the event loop. An asynchronous context manager, which
    closes itself at the end.

    Concurrency: all methods, from any task of the client's event loop.
""": """\
    or removed since. A context manager, which closes itself at the end.

    Thread safety: all methods.
""",
    },
}
