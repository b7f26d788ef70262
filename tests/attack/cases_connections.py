"""Attacks 16, 26 and 27: first copies of robots, certificates that expire, asyncio clients."""

from __future__ import annotations

import contextlib
import datetime
import math
import tempfile
import threading
import time
from pathlib import Path

import trustme
import zenoh

from tests.processes.ports import free_endpoint
from tests.support import messages
from tests.support.certificates import issue
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import TransformException
from zenoh_tf_client import Credentials, TransformClient

from .arena import Arena, Finding, beside, case
from .processes import HERE, Process, Server

_VALID_S = 6.0
_ROBOT_FRAMES = 10_000
_COPY_TIMEOUT_S = 60.0


def _pose(child: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", child, stamp_ns, Transform((1, 0, 0)))


def _client(server: Server) -> TransformClient:
    return TransformClient.connect(server.endpoint, timeout_s=20, reads="query")


def _wait_for(opened: zenoh.Session, counter: str, least: float, timeout_s: float) -> float:
    """Seconds until a counter of `stats` has reached a value; infinity if it does not in time."""
    start_s = time.monotonic()
    while time.monotonic() - start_s < timeout_s:
        if messages.stats(opened)[counter] >= least:
            return time.monotonic() - start_s
        time.sleep(0.1)
    return math.inf


@case("16: a site takes the first copy of a robot with 10,000 frames, beside lookups at the site")
def first_copy_of_a_robot(arena: Arena) -> list[Finding]:
    endpoint = free_endpoint()
    took_s = math.inf
    with tempfile.TemporaryDirectory() as folder:
        state = ("--state-dir", str(Path(folder, "state")))
        with arena.opened(*state) as (_, opened):
            body = messages.star("part_", 0, _ROBOT_FRAMES, static=True)
            messages.send(opened, "commit", body)
        with arena.server("--mirror-of", f"robot1={endpoint}") as site:

            def attack() -> None:
                nonlocal took_s
                # It has its frames before anyone can reach it, so all of them are in the copy.
                with (
                    arena.server(*state, endpoint=endpoint),
                    messages.session(site.endpoint) as opened,
                ):
                    counter = "robot_stored/robot1"
                    took_s = _wait_for(opened, counter, _ROBOT_FRAMES, _COPY_TIMEOUT_S)

            found = beside(site, ["lookup"], attack, 4.0)
    return [Finding("first copy", took_s, "s", 10.0), *found.outages(), found.p99("lookup")]


class _Reader:
    """A client that reads all the time."""

    def __init__(self, tf: TransformClient) -> None:
        self._tf = tf
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._read)
        self.reads = self.failures = 0
        self.longest_s = 0.0

    def __enter__(self) -> _Reader:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def _read(self) -> None:
        last_s = time.monotonic()
        while not self._ending.wait(0.01):
            try:
                self._tf.frames()
                self.reads += 1
            except TransformException:
                self.failures += 1
            now_s = time.monotonic()
            self.longest_s, last_s = max(self.longest_s, now_s - last_s), now_s


def _outcome(tf: TransformClient, *, write: bool = False) -> tuple[str, float]:
    """The class of what a call raises, and the seconds it takes."""
    start_s = time.monotonic()
    try:
        tf.set_transform(_pose("late", 1)) if write else tf.frames()
        outcome = "ok"
    except TransformException as error:
        outcome = type(error).__name__
    return outcome, time.monotonic() - start_s


@case("26: a client's certificate expires while the client is connected, beside another client")
def expiring_certificate(arena: Arena) -> list[Finding]:
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        authority = trustme.CA()
        server_files = issue(authority, folder, "server", ["127.0.0.1"])
        flags = ["--tls-certificate", str(server_files.certificate), "--tls-key"]
        flags += [str(server_files.key), "--tls-ca", str(server_files.ca), "--no-share"]
        endpoint = free_endpoint().replace("tcp/", "tls/")
        stack.enter_context(arena.server(*flags, endpoint=endpoint))

        def connect(own: Credentials, timeout_s: float) -> TransformClient:
            return TransformClient.connect(endpoint, timeout_s=timeout_s, credentials=own)

        good = stack.enter_context(connect(issue(authority, folder, "good"), 10.0))
        end = datetime.datetime.now(datetime.timezone.utc) + datetime.timedelta(seconds=_VALID_S)
        expiring = issue(authority, folder, "short", end=end)
        short = stack.enter_context(connect(expiring, 3.0))
        with _Reader(good) as reader:
            begins = _outcome(short)[0]
            time.sleep(_VALID_S + 2.0)
            read, read_s = _outcome(short)
            write, write_s = _outcome(short, write=True)
            again = ""
            try:
                connect(expiring, 3.0).close()
            except TransformException as error:
                again = f"{type(error).__name__}: {error}"
        known = _outcome(good)[0]
    reported = "AccessDenied" in again and "expired" in again
    failed = ("ServerUnavailable", "AccessDenied")
    return [
        Finding("a call before that fails", begins != "ok", "", 0, begins),
        Finding("a read after it does not fail", read not in failed, "", 0, read),
        Finding("a write after it does not fail", write not in failed, "", 0, write),
        Finding("they fail after", max(read_s, write_s), "s", 4.0),
        Finding("connect does not say why", not reported, "", 0, again[-60:]),
        Finding("reads of the other that fail", reader.failures, "", 0, f"of {reader.reads}"),
        Finding("its longest read", 1e3 * reader.longest_s, "ms", 500.0),
        Finding("the server harms it later", known != "ok", "", 0, known),
    ]


@case(
    "27: an asyncio client has 5,000 calls at once under way, beside light clients", "asyncio_flood"
)
@case(
    "27b: an asyncio client cancels 500 calls again and again, also lookups that wait",
    "asyncio_cancels",
)
def _asyncio(arena: Arena, program: str) -> list[Finding]:
    """An asyncio program beside light clients, and what is left of it when it is killed."""
    with arena.server("--no-share") as server, messages.session(server.endpoint):
        command = [server.python, str(HERE / "sdk.py"), program, server.endpoint]
        with Process(command) as script:
            found = beside(server, ("lookup", "set", "info"), script.go, 6.0, load=1)
            alive = script.running
        with _client(server) as tf:
            start_s = time.monotonic()
            while (left := tf.stats()["waiters"]) and time.monotonic() < start_s + 20:
                time.sleep(0.05)
    return [
        *found.outages(),
        Finding("the program has ended", not alive, "", 0),
        Finding("waiters left after a kill", left, "", 0),
        Finding("waiters are held", time.monotonic() - start_s, "s", 5.0),
    ]
