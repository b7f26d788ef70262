"""Zenoh of this version still needs each workaround of `zenoh_tf/_zenoh/`.

A test that fails says that a workaround can go: the file that it names, and its test here.
`tests/ingest/test_abandoned_keys.py` shows for `abandoned_keys.py` that the router keeps the keys.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from zenoh.handlers import Callback, FifoChannel

from tests.processes.ports import free_endpoint
from zenoh_tf._net import zenoh_config

pytestmark = pytest.mark.service  # takes as long as tests with a server

#: Far above what both sockets of a link, and Zenoh's queues, have room for.
LONG = b"x" * (8 << 20)


@pytest.fixture
def router() -> Iterator[tuple[str, zenoh.Session]]:
    endpoint = free_endpoint()
    with zenoh.open(zenoh_config.router([endpoint])) as session:
        yield endpoint, session


def run(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_a_reply_to_a_client_that_does_not_read_blocks(router: tuple[str, zenoh.Session]) -> None:
    """`replies.py`, `outbox_links.py`, `link_sockets.py` (eclipse-zenoh/zenoh#1876)."""
    endpoint, server = router
    queryable = server.declare_queryable("asked", FifoChannel(1))
    go_on = threading.Event()
    with zenoh.open(zenoh_config.client([endpoint], 5.0)) as client:
        # On Zenoh's receive thread, which reads nothing more.
        stuck = threading.Event()

        def replied(_: zenoh.Reply) -> None:
            stuck.set()
            go_on.wait(30)

        each = zenoh.ConsolidationMode.NONE
        callback = Callback(replied, lambda: None, indirect=False)
        client.get("asked", callback, consolidation=each)
        query = queryable.recv()
        query.reply("asked", b"first")
        assert stuck.wait(10)

        def reply() -> None:
            for _ in range(4):
                query.reply("asked", LONG)

        thread = threading.Thread(target=reply)
        thread.start()
        thread.join(0.7)
        blocks = thread.is_alive()
        go_on.set()
        thread.join()
        query.drop()
    assert blocks


def test_there_is_no_call_that_sends_without_blocking() -> None:
    """The same files; eclipse-zenoh/zenoh#2587 proposes `try_put`."""
    kinds = (zenoh.Session, zenoh.Publisher, zenoh.Query)
    assert [name for kind in kinds for name in dir(kind) if name.startswith("try_")] == []


@pytest.mark.skipif(
    not (3, 11) <= sys.version_info < (3, 14),
    reason="from 3.14 on a thread waits, and is not ended; on 3.10 it depends on chance",
)
def test_a_thread_in_zenoh_aborts_a_program_that_ends() -> None:
    """`calls.py`: such a thread comes back while the interpreter is being finalized."""
    script = """
import sys, threading, time, zenoh
from zenoh.handlers import FifoChannel
from zenoh_tf._net import zenoh_config
session = zenoh.open(zenoh_config.router([sys.argv[1]]))
asked = session.declare_queryable("asked", FifoChannel(8))
threading.Thread(target=lambda: list(session.get("asked")), daemon=True).start()
class Late:
    def __init__(self, query):
        self.query, self.sleep = query, time.sleep
    def __del__(self):
        self.query.drop()
        self.sleep(20)
sys.late = Late(asked.recv())  # the thread is in Zenoh until this is deleted, at the very end
"""
    done = run(script, free_endpoint())
    assert done.returncode == -signal.SIGABRT, done.stderr


def test_a_session_cannot_be_opened_in_a_forked_child(router: tuple[str, zenoh.Session]) -> None:
    """`calls.py`: nothing of Zenoh works in a child of a process that has used it."""
    script = """
import os, signal, sys, zenoh
from zenoh_tf._net import zenoh_config
session = zenoh.open(zenoh_config.client([sys.argv[1]], 5.0))
if os.fork() == 0:
    signal.alarm(1)
    list(session.get("asked"))
    os._exit(0)
print(os.waitstatus_to_exitcode(os.wait()[1]), flush=True)
os._exit(0)
"""
    router[1].declare_queryable("asked", lambda query: query.reply("asked", b""))
    done = run(script, router[0])
    assert int(done.stdout) != 0, done.stderr


def test_a_signal_waits_until_a_session_is_open() -> None:
    """`opening.py`."""
    heard: list[float] = []
    before = signal.signal(signal.SIGUSR1, lambda *_: heard.append(time.monotonic()))
    main = threading.get_ident()
    timer = threading.Timer(0.1, signal.pthread_kill, (main, signal.SIGUSR1))
    begin_s = time.monotonic()
    timer.start()
    try:
        with pytest.raises(zenoh.ZError):
            zenoh.open(zenoh_config.client([free_endpoint()], 0.8))
    finally:
        timer.join()
        signal.signal(signal.SIGUSR1, before)
    assert heard[0] - begin_s > 0.6


def test_an_error_says_not_why_no_session_is_open(tmp_path: Path) -> None:
    """`connect_failure.py`: the texts are the same where nothing listens, and where the user is
    refused."""
    users = tmp_path / "users"
    users.write_text("nav:secret\n")
    closed, asks = free_endpoint(), free_endpoint()
    security = {"transport/auth/usrpwd/dictionary_file": str(users)}

    def failure(endpoint: str) -> str:
        with pytest.raises(zenoh.ZError) as caught:
            zenoh.open(zenoh_config.client([endpoint], 0.3))
        return str(caught.value).replace(endpoint, "ENDPOINT")

    with zenoh.open(zenoh_config.router([asks], security=security)):
        assert failure(asks) == failure(closed)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_what_zenoh_gives_its_receive_threads() -> None:
    """`receive_threads.py`: there are two. `thread_states.py`: Python's state of such a thread
    ends with each callback."""
    script = """
import json, sys, threading, zenoh
from pathlib import Path
from zenoh.handlers import Callback
from zenoh_tf._net import zenoh_config
router = zenoh.open(zenoh_config.router([sys.argv[1]]))
client = zenoh.open(zenoh_config.client([sys.argv[1]], 5.0))
kept, seen, done = threading.local(), set(), threading.Event()
again = []
def received(sample):
    thread = threading.get_ident()
    if thread in seen:
        again.append(hasattr(kept, "value"))
        done.set()
    seen.add(thread)
    kept.value = 1
client.declare_subscriber("key", Callback(received, indirect=False))
while not done.wait(0.01):
    router.put("key", b"")
names = [(task / "comm").read_text().strip() for task in Path("/proc/self/task").iterdir()]
print(json.dumps([sum(name.startswith("rx-") for name in names), again[0]]), flush=True)
client.close()
router.close()
"""
    done = run(script, free_endpoint())
    assert json.loads(done.stdout) == [2, False], done.stderr
