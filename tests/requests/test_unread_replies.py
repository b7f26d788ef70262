"""A client that does not read its replies, or dies, delays nobody else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.line_process import LineProcess
from tests.processes.servers import ServerProcess
from tests.support import messages
from tests.support.raw import raw
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf.errors import LimitExceeded
from zenoh_tf_client import TransformClient
from zenoh_tf_server.limits import Limits

pytestmark = pytest.mark.slow

#: The time-out of the other clients: far above what a loaded machine needs, and below the 5 to
#: 10 s for which everything stood still when a reply blocked.
OUTAGE_S = 4.0
#: Replies of 7 MB.
ROWS = 100_000


class ReaderProcess(LineProcess):
    """A `reader_process`, to freeze."""

    def __init__(self, endpoint: str, rows: int, count: int) -> None:
        script = Path(__file__).parents[1] / "processes/reader_process.py"
        super().__init__(script, endpoint, str(rows), str(count))

    def ask_and_freeze(self) -> None:
        """Ask, and read nothing of the replies."""
        assert self.ask("ask and freeze") == "sent"
        forks.wait_until_stopped(self.pid)

    def counts(self) -> tuple[int, int]:
        """How many lookups were answered and refused, once all have ended."""
        answered, refused = map(int, self.ask("count").split())
        return answered, refused


StartReader = Callable[..., ReaderProcess]


@pytest.fixture
def start_reader() -> Iterator[StartReader]:
    running: list[ReaderProcess] = []

    def start(server: ServerProcess, rows: int = ROWS, count: int = 8) -> ReaderProcess:
        running.append(ReaderProcess(server.endpoint, rows, count))
        return running[-1]

    yield start
    for reader in running:
        reader.kill()


def fill(tf: TransformClient) -> None:
    tf.set_transform(StampedTransform("map", "base", 1, Transform()))


def work_beside(server: ServerProcess, tf: TransformClient, until: Callable[[], bool]) -> None:
    """A client reads and writes, and others connect: that changes Zenoh's routing tables, which
    a blocked reply would hold. A call that takes OUTAGE_S fails."""
    while not until():
        tf.lookup_transform("map", "base")
        tf.set_transform(StampedTransform("map", "base", 1, Transform()))
        tf.frames()
        server.connect(OUTAGE_S).close()


def rounds(number: int) -> Callable[[], bool]:
    left = iter(range(number))
    return lambda: next(left, None) is None


@pytest.mark.parametrize("frozen", [1, 3])
def test_frozen_clients(server: ServerProcess, start_reader: StartReader, frozen: int) -> None:
    with server.connect(OUTAGE_S) as tf:
        fill(tf)
        readers = [start_reader(server) for _ in range(frozen)]
        for reader in readers:
            reader.ask()
            reader.freeze()
        work_beside(server, tf, rounds(8))
        for reader in readers:
            reader.go_on()
        # A client that was away for less than Zenoh's lease has lost nothing.
        assert [reader.counts() for reader in readers] == [(8, 0)] * frozen


def test_a_client_that_stays_frozen_is_cut_off_alone(
    server: ServerProcess, start_reader: StartReader
) -> None:
    with server.connect(OUTAGE_S) as tf:
        fill(tf)
        readers = [start_reader(server) for _ in range(2)]
        for reader in readers:
            reader.ask()
            reader.freeze()
        work_beside(server, tf, lambda: tf.stats()["unread_reply_bytes"] > 0)
        work_beside(server, tf, lambda: tf.stats()["unread_reply_bytes"] == 0)


def test_a_client_killed_in_the_middle_of_replies(
    server: ServerProcess, start_reader: StartReader
) -> None:
    with server.connect(OUTAGE_S) as tf:
        fill(tf)
        for _ in range(3):
            reader = start_reader(server)
            reader.ask()
            reader.kill()
        work_beside(server, tf, rounds(5))


def test_requests_of_a_client_with_many_unread_replies_are_refused(
    start_server: StartServer, start_reader: StartReader
) -> None:
    # Room for 7 of 20 replies. The refusals, which hold their requests of 2 MB, do not add up to
    # twice the limit, at which the client would be cut off.
    server = start_server()
    with server.connect(30.0) as tf:
        fill(tf)
        reader = start_reader(server, count=20)
        reader.ask_and_freeze()
        while (counters := tf.stats())["unread_reply_bytes"] < Limits().unread_reply_bytes:
            tf.lookup_transform("map", "base")  # another client is not refused
        while counters["pending_queries"]:
            counters = tf.stats()
        reader.go_on()
        answered, refused = reader.counts()
        assert answered + refused == 20
        assert answered >= 1
        assert refused >= 1
        reader.ask()  # it is served again
        assert sum(reader.counts()) == 40
        assert tf.can_transform("map", "base")


def test_a_raw_client_gets_an_error_for_a_reply_that_is_too_long(server: ServerProcess) -> None:
    with server.connect() as tf, raw(server.endpoint) as zenoh_client:
        fill(tf)
        body = messages.same_lookup(50_000, "map", "base", op=wire.OP_LATEST)
        error = zenoh_client.error("lookup", body)
        assert isinstance(error, LimitExceeded)
        assert error.field == "whole_reply_bytes"
