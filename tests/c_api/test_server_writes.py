"""Writes and transactions of a C++ program at real servers, whose queries this process sends."""

from __future__ import annotations

import random
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from zenoh_tf import StampedTransform, Transform
from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import NO_CREDENTIALS
from zenoh_tf_client import Credentials, Transaction

from .readers import Reader

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")

LONG_MS = 120_000
Query = Callable[[str, bytes, float], bytes]


def query_of(session: zenoh.Session) -> Query:
    """Send a query by a session, and return the payload of its reply."""

    def query(key: str, payload: bytes, timeout_s: float) -> bytes:
        for reply in session.get(key, payload=payload, timeout=timeout_s):
            answer = reply.ok or reply.err
            assert answer is not None
            return bytes(answer.payload)
        return b""

    return query


@contextmanager
def writer_of(
    server: ServerProcess,
    folder: Path,
    timeout_ms: int = LONG_MS,
    credentials: Credentials = NO_CREDENTIALS,
) -> Iterator[Reader]:
    config = zenoh_config.client([server.endpoint], 5.0, credentials=credentials)
    with zenoh.open(config) as session, Reader() as writer:
        writer.query = query_of(session)
        writer.do("open", server.tree, folder, LONG_MS)
        writer.do("write_through", timeout_ms)
        yield writer


def set_x(writer: Reader, stamp: int, x: float) -> tuple[str, list[str]]:
    return writer.ask("set", "map", "base", stamp, 0, x, 0, 0, 0, 0, 0, 1)


def x_of(writer: Reader) -> float:
    return float(writer.do("lookup", "map", "base", "-", 0)[1])


def test_what_it_writes_is_everybodys(start_sharing: StartServer, socket_folder: Path) -> None:
    server = start_sharing(tree="a/b*ü\u2028\u0085%")
    with writer_of(server, socket_folder) as writer, server.connect() as tf:
        assert set_x(writer, 1000, 2)[0] == "ok"
        assert x_of(writer) == 2  # at once, in the server's memory
        assert tf.lookup_latest_transform("map", "base").transform.translation[0] == 2
        assert writer.do("append", "map", "base", 20_000_000_000, 5) == ["1"]
        assert tf.lookup_transform("map", "base", 20_000_000_000).transform.translation[0] == 5
        assert writer.do("append", "map", "base", 0, 5) == ["0"]  # too old
        writer.do("set_xact", "map", "arm", "arm", "hand", 1000, 1, 3)
        assert tf.lookup_transform("map", "hand", 1000).transform.translation[0] == 4
        writer.do("remove", "hand")
        assert "hand" not in tf.frames()
        writer.do("clear")
        assert writer.ask("lookup", "map", "base", "-", 0)[0] != "ok"


def test_errors_have_their_facts(start_sharing: StartServer, socket_folder: Path) -> None:
    server = start_sharing("--cache-time", "1s")
    with writer_of(server, socket_folder) as writer:
        assert set_x(writer, 10_000_000_000, 1)[0] == "ok"
        code, words = writer.ask("set_xact", "base", "map", "map", "x", 10_000_000_000, 0, 0)
        assert code == "ZTF_INVALID_ARGUMENT" and "cycle" in " ".join(words)
        assert writer.ask("remove", "nobody")[0] == "ZTF_LOOKUP"
        assert writer.ask("set_xact", "map", "base", "map", "x", 1, 0, 0)[0] == (
            "ZTF_INVALID_ARGUMENT"  # too old
        )


def test_transactions_of_several_clients_are_all_counted(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    server = start_sharing()
    rounds = 50

    def increment(transaction: Transaction) -> None:
        newest = transaction.lookup_latest_transform_xact("map", "base")
        pose = Transform((newest.transform.translation[0] + 1, 0, 0))
        transaction.set_transform(StampedTransform("map", "base", newest.stamp_ns + 1, pose))

    def increment_by_python() -> None:
        with server.connect() as tf:
            for _ in range(rounds):
                tf.run_transaction(increment, attempts=1000)

    def increment_by_c() -> None:
        with writer_of(server, socket_folder) as writer:
            for _ in range(rounds):
                writer.do("increment", "map", "base", 1000)

    with writer_of(server, socket_folder) as writer:
        assert writer.do("increment", "map", "base", 1) == ["1"]  # of a frame that did not exist
        jobs = [increment_by_c, increment_by_c, increment_by_python]
        threads = [threading.Thread(target=job) for job in jobs]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert x_of(writer) == 1 + rounds * len(jobs)


def test_a_conflict_is_an_error_after_the_attempts(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    server = start_sharing()
    with writer_of(server, socket_folder) as writer, server.connect() as tf:
        writer.do("increment", "map", "base", 1)
        send = writer.query

        def change_first(key: str, payload: bytes, timeout_s: float) -> bytes:
            newest = tf.lookup_latest_transform("map", "base")
            tf.set_transform(
                StampedTransform("map", "base", newest.stamp_ns + 1, Transform((9, 0, 0)))
            )
            return send(key, payload, timeout_s)

        writer.query = change_first
        assert writer.ask("increment", "map", "base", 3)[0] == "ZTF_CONFLICT"
        assert x_of(writer) == 9


def test_a_write_whose_reply_is_lost_is_done_once(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    server = start_sharing()
    with writer_of(server, socket_folder) as writer:
        send = writer.query
        sent: list[bytes] = []

        def lose_first(key: str, payload: bytes, timeout_s: float) -> bytes:
            reply = send(key, payload, timeout_s)
            if key.endswith("/commit"):
                sent.append(payload)
            return reply if len(sent) % 3 == 0 else b"Timeout"

        writer.do("increment", "map", "base", 1)
        writer.query = lose_first
        for n in range(2, 12):
            writer.do("increment", "map", "base", 1)
            assert x_of(writer) == n
        assert len(sent) == 30 and len(set(sent)) == 10


def test_without_replies_the_outcome_is_said(
    start_sharing: StartServer, socket_folder: Path
) -> None:
    server = start_sharing()
    with writer_of(server, socket_folder, 200) as writer:
        writer.query = lambda *_: b""
        code, words = set_x(writer, 1, 1)
        assert code == "ZTF_SERVER_UNAVAILABLE" and "tf/v1/main" in " ".join(words)
    with writer_of(server, socket_folder, 2000) as writer:  # enough for a reply to hello
        send = writer.query
        writer.query = lambda key, *rest: send(key, *rest) if key.endswith("/hello") else b""
        assert set_x(writer, 1, 1)[0] == "ZTF_OUTCOME_UNKNOWN"
        writer.query = send
        assert set_x(writer, 1, 1)[0] == "ok"


def test_forged_replies_are_typed_errors(start_sharing: StartServer, socket_folder: Path) -> None:
    server = start_sharing()
    rng = random.Random(1)
    with writer_of(server, socket_folder, 20) as writer:
        send = writer.query

        def forge(key: str, payload: bytes, timeout_s: float) -> bytes:
            reply = bytearray(send(key, payload, timeout_s))
            for _ in range(rng.randrange(4)):
                reply[rng.randrange(len(reply))] = rng.randrange(256)
            return bytes(reply[: rng.randrange(len(reply) + 1)] if rng.random() < 0.3 else reply)

        writer.query = forge
        codes = {set_x(writer, stamp, 1)[0] for stamp in range(1, 150)}
        assert {"ok", "ZTF_OUTCOME_UNKNOWN"} < codes
        assert all(code == "ok" or code.startswith("ZTF_") for code in codes)
        writer.query = send
        wait = [set_x(writer, 1000, 1)[0] for _ in range(50)]
        assert "ok" in wait


def test_it_writes_to_the_next_server(start_sharing: StartServer, socket_folder: Path) -> None:
    server = start_sharing()
    with writer_of(server, socket_folder) as writer:
        assert set_x(writer, 1, 1)[0] == "ok"
        server.kill()
        server = start_sharing(endpoint=server.endpoint)
        with server.connect() as tf:
            tf.set_transform(StampedTransform("map", "base", 5, Transform((7, 0, 0))))
        assert float(writer.do("lookup", "map", "base", "-", LONG_MS)[1]) == 7
        assert set_x(writer, 6, 8)[0] == "ok"
        assert x_of(writer) == 8
