"""What requests to a replica and its replies say, and who lets a replica in."""

from __future__ import annotations

from pathlib import Path

import msgpack
import pytest

from tests.conftest import StartServer
from tests.processes.replicas import FRAMES, reads_near, seen, step
from tests.processes.servers import ServerProcess
from tests.support.raw import raw
from tests.support.waiting import wait_until
from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf._net.credentials import Credentials
from zenoh_tf.errors import InvalidArgumentException, ReplicaBehind
from zenoh_tf_client import TransformClient
from zenoh_tf_client.requests import columns

# --- messages and flags


def test_what_replies_say(primary: ServerProcess, replica: ServerProcess) -> None:
    with primary.connect(10) as tf, raw(replica.endpoint) as wires:
        tf.set_transforms_xact(step(1))
        receipt = tf.last_receipt
        assert receipt is not None
        body = wire.one_read("map", FRAMES[0], wire.OP_COMMON, wire.NO_STAMP)

        def ask(name: str, message: wire.Message) -> wire.Message:
            router = str(next(iter(wires.session.info.routers_zid())))
            key = keys.replica_request("main", router, name)
            reply = next(iter(wires.session.get(key, payload=wire.pack(message), timeout=5)))
            answer = reply.ok or reply.err
            assert answer is not None
            return wire.unpack(answer.payload.to_bytes())

        wait_until(
            lambda: "error" not in ask("lookup", body | wire.least(tf.instance, receipt.seq)), ""
        )
        for name, message in (("lookup", body), ("info", {"v": 1, "what": "frames"})):
            reply = ask(name, message)
            state = wire.parse_replica(reply)
            assert state is not None
            assert state[0] == receipt.seq
            assert 0 <= state[1] < 20 * 10**9
            assert reply["instance"] == tf.instance
        hello = ask("hello", {"v": 1, "what": "hello"})["value"]
        assert hello["instance"] == tf.instance
        assert hello["replica"] != tf.instance
        for least in (wire.least(tf.instance, receipt.seq + 1), wire.least("of another server", 0)):
            error = wire.decode_error(ask("lookup", body | least)["error"])
            assert isinstance(error, ReplicaBehind)
        for malformed in ({"least_seq": 1}, {"least_seq": -1, "least_instance": "x"}):
            error = wire.decode_error(ask("lookup", body | malformed)["error"])
            assert error.field in (wire.LEAST_INSTANCE, wire.LEAST_SEQ)
        commit = {"v": 1, "operations": [["commit", wire.commit_body(_commit())]]}
        error = wire.decode_error(ask("batch", commit)["replies"][0]["error"])
        assert isinstance(error, InvalidArgumentException)
        assert "accepts no writes" in str(error)
        assert tf.last_receipt == receipt


def test_garbage_harms_nobody(replica: ServerProcess) -> None:
    """Each request gets an error, and the replica continues to serve."""
    body = wire.one_read("map", FRAMES[0], wire.OP_COMMON, wire.NO_STAMP)
    request = wire.pack(body | wire.least("x", 1))
    payloads = [b"", b"\xc1", b"\x80", request[:-1], request + b"\0", b"\xdf" + b"\xff" * 9]
    values: tuple[object, ...] = (None, -1, 1.5, "x", [], b"")
    for name in ("least_seq", "least_instance"):
        payloads += [wire.pack(body | {name: value}) for value in values]
    payloads += [request[:i] + bytes((255 - request[i],)) + request[i + 1 :] for i in range(90)]
    with raw(replica.endpoint) as wires, replica.connect(10) as tf:
        router = str(next(iter(wires.session.info.routers_zid())))
        for name in keys.REPLICA_REQUEST_TYPES:
            for payload in payloads:
                key = keys.replica_request("main", router, name)
                (reply,) = wires.session.get(key, payload=payload, timeout=5)
                assert (reply.ok or reply.err) is not None
        for name in ("commit", "admin", "snapshot", "set", "lookup/more"):
            key = keys.replica_request("main", router, name)
            assert list(wires.session.get(key, payload=request, timeout=5)) == []
        tf.set_transforms_xact(step(1))
        assert seen(tf) == 1


def _commit() -> wire.Commit:
    return columns.commit(step(9))


@pytest.mark.parametrize(
    ("count", "first"), [(1, 0x82), (14, 0x8F), (15, 0xDE), (16, 0xDE), (300, 0xDE)]
)
def test_a_field_is_added_to_packed_bytes(count: int, first: int) -> None:
    message = {"v": 1} | {f"field{i}": i for i in range(count - 1)}
    found = wire.with_field(wire.pack(message), "replica", {"seq": 5, "age_ns": 1 << 40})
    assert found[0] == first
    state = wire.parse_replica(wire.unpack(found) if count < 200 else _unpacked(found))
    assert state == (5, 1 << 40, 5)
    assert found == wire.pack(message | {"replica": {"seq": 5, "age_ns": 1 << 40}})


def _unpacked(data: bytes) -> wire.Message:
    message: wire.Message = msgpack.unpackb(data)
    return message


def test_a_primary_that_asks_who_connects(start_server: StartServer, tmp_path: Path) -> None:
    """The replica's user and password are those of a client."""
    users = tmp_path / "users"
    users.write_text("site:secret\n")
    password = tmp_path / "password"
    password.write_text("secret\n")
    for path in (users, password):
        path.chmod(0o600)
    primary = start_server("--users", str(users))
    replica = start_server(
        *("--replica-of", primary.endpoint, "--user", "site", "--password-file", str(password)),
        *("--users", str(users)),
    )
    own = Credentials(user="site", password="secret")
    with TransformClient.connect(replica.endpoint, timeout_s=10, credentials=own) as tf:
        tf.set_transforms_xact(step(1))
        assert seen(tf) == 1
        assert reads_near(tf)
