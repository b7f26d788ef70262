"""Attacks 25 to 27: servers that hear each other, certificates that expire, asyncio clients."""

from __future__ import annotations

import contextlib
import datetime
import math
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import trustme

from tests.processes.ports import free_endpoint
from tests.support import messages
from tests.support.certificates import issue
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import TransformException
from zenoh_tf_client import Credentials, TransformClient

from .arena import Arena, Finding, beside, case
from .processes import HERE, Process, Server

_SITE = "site"  # the tree of the server that joins the other one's network
_SET = 20
_VALID_S = 6.0


def _pose(child: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", child, stamp_ns, Transform((1, 0, 0)))


def _client(server: Server, tree: str = "main") -> TransformClient:
    return TransformClient.connect(server.endpoint, tree, 20, reads="query")


@contextlib.contextmanager
def _joined(arena: Arena, server: Server, *flags: str) -> Iterator[Process]:
    """A server of another tree on a server's network."""
    where = ("--connect", server.endpoint, "--tree", _SITE)
    with Process([arena.python, "-m", "zenoh_tf_server", *where, *flags]) as site:
        yield site


def _echoes(robot: Server, *, both_set: bool) -> list[Finding]:
    """What two servers publish on ROS 2 while clients set a moving and a static frame."""
    with _client(robot) as here, _client(robot, _SITE) as there:
        sources = (here, there) if both_set else (here,)
        time.sleep(2.0)
        for number in range(_SET):
            for index, tf in enumerate(sources):
                tf.set_transform(_pose(f"moves {index}", time.time_ns()))
            if number % 5 == 0:  # sooner than a change comes back
                for index, tf in enumerate(sources):
                    tf.set_transform(_pose(f"stays {index}", number), static=True)
            time.sleep(0.03)
        time.sleep(2.0)

        def seen() -> tuple[int, int, int]:
            stats = [tf.stats() for tf in (here, there)]
            published = sum(each.get("ros2_published_transforms", 0) for each in stats)
            frames, commits = (sum(each[name] for each in stats) for name in ("frames", "commits"))
            return published, frames, commits

        before, after_s = seen(), 3.0
        time.sleep(after_s)
        after = seen()
        fights = sum(each.conflicts for tf in (here, there) for each in tf.authorities())
    own = len(sources)
    # Each moving sample once; all static links of a server in each message of them.
    most = own * _SET + own * 2 * (_SET // 5)
    return [
        Finding("transforms published", after[0], "", most, f"{own * _SET} set"),
        Finding("published while nothing is set", after[0] - before[0], "", 0, f"{after_s:g} s"),
        Finding("frames made meanwhile", after[1] - before[1], "", 0, f"{after[1]} in all"),
        Finding("commits meanwhile", after[2] - before[2], "", 0, f"{after[2]} in all"),
        Finding("conflicts between authorities", fights, "", 0 if both_set else math.inf),
    ]


@case("25: two servers publish on one ROS 2 network, and both take what is there")
def two_servers_on_ros2(arena: Arena) -> list[Finding]:
    flags = ("--no-share", "--ros2", "--ros2-publish")
    with arena.server(*flags) as server, _joined(arena, server, *flags):
        return _echoes(server, both_set=True)


@case("25b: a site publishes a robot's frames on ROS 2, where the robot's server takes them")
def robot_that_hears_its_site(arena: Arena) -> list[Finding]:
    with (
        arena.server("--no-share", "--ros2") as robot,
        _joined(arena, robot, "--no-share", "--ros2-publish", "--mirror-of", f"r={robot.endpoint}"),
    ):
        return _echoes(robot, both_set=False)


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
        end = datetime.datetime.now(datetime.UTC) + datetime.timedelta(seconds=_VALID_S)
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
