"""What requests to a replica and its replies say, and who lets a replica in."""

from __future__ import annotations

from pathlib import Path

import msgpack
import pytest

from tests.conftest import StartServer
from tests.processes.replicas import FRAMES, seen, step, wait_for_writes
from tests.processes.servers import ServerProcess
from tests.support.raw import raw
from tests.support.waiting import wait_until
from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf._net.credentials import Credentials
from zenoh_tf.errors import ReadOnlyReplica, ServerBusy, TransformException
from zenoh_tf_client import TransformClient
from zenoh_tf_client.requests import columns

# --- messages and flags


def test_what_replies_say(primary: ServerProcess, replica: ServerProcess) -> None:
    with primary.connect(10) as tf, raw(replica.endpoint) as wires, raw(primary.endpoint) as far:
        tf.set_transforms_xact(step(1))
        receipt = tf.last_receipt
        assert receipt is not None
        body = wire.one_read("map", FRAMES[0], wire.OP_COMMON, wire.NO_STAMP)
        floor = wire.floor_field(*receipt)
        wait_until(lambda: "error" not in wires.query("lookup", body | floor), "it is behind")
        infos = {"v": 1, "what": "frames"}
        for name, message in (("lookup", body), ("info", infos), ("snapshot", {"v": 1})):
            reply, first = wires.query(name, message), far.query(name, message)
            assert reply["instance"] == tf.instance
            age_s = wire.parse_age_s(reply)
            assert age_s is not None and 0 <= age_s < 20
            assert reply.keys() - {wire.AGE_NS} == first.keys()
            for one in (wires, far):
                assert one.query(name, message | floor)["seq"] == receipt.seq
                assert one.query(name, message | wire.floor_field("", 0))["seq"] == receipt.seq
        hello = wires.query("hello", {"v": 1, "what": "hello"})["value"]
        assert (hello["instance"], hello["primary"]) == (tf.instance, primary.endpoint)
        missing = wire.floor_field(tf.instance, receipt.seq + 1)
        assert isinstance(_error(wires.query("lookup", body | missing)), ServerBusy)
        assert "error" not in far.query("lookup", body | missing)  # nobody has more than it has
        for request_type, message in WRITES:
            error = _error(wires.query(request_type, message))
            assert isinstance(error, ReadOnlyReplica)
            assert error.value == primary.endpoint
        assert tf.last_receipt == receipt


WRITES: list[tuple[str, wire.Message]] = [
    ("commit", wire.commit_body(columns.commit(step(9)))),
    ("batch", {"v": 1, "operations": [["commit", wire.commit_body(columns.commit(step(9)))]]}),
    ("admin", wire.call_body("clear")),
]


def _error(reply: wire.Message) -> TransformException:
    return wire.decode_error(reply["error"])


def test_garbage_harms_nobody(primary: ServerProcess, replica: ServerProcess) -> None:
    """Each request gets an error, and the replica continues to serve."""
    body = wire.one_read("map", FRAMES[0], wire.OP_COMMON, wire.NO_STAMP)
    request = wire.pack(body | wire.floor_field("x", 1))
    payloads = [b"", b"\xc1", b"\x80", request[:-1], request + b"\0", b"\xdf" + b"\xff" * 9]
    values: tuple[object, ...] = (None, -1, 1.5, "x", [], b"")
    payloads += [wire.pack(body | {wire.FLOOR: value}) for value in values]
    for name in ("instance", "seq"):
        floors = ({"instance": "x", "seq": 1} | {name: value} for value in values)
        payloads += [wire.pack(body | {wire.FLOOR: floor}) for floor in floors]
    payloads += [request[:i] + bytes((255 - request[i],)) + request[i + 1 :] for i in range(90)]
    with raw(replica.endpoint) as wires, replica.connect(10) as tf:
        for name in keys.REQUEST_TYPES:
            for payload in payloads:
                (reply,) = wires.session.get(keys.request("main", name), payload=payload, timeout=5)
                assert (reply.ok or reply.err) is not None
        with primary.connect(10) as writer:
            writer.set_transforms_xact(step(1))
            wait_for_writes(writer, tf)
        assert seen(tf) == 1
    assert "internal error" not in replica.log


@pytest.mark.parametrize(
    ("count", "first"), [(1, 0x82), (14, 0x8F), (15, 0xDE), (16, 0xDE), (300, 0xDE)]
)
def test_a_field_is_added_to_packed_bytes(count: int, first: int) -> None:
    message = {"v": 1} | {f"field{i}": i for i in range(count - 1)}
    found = wire.with_field(wire.pack(message), wire.AGE_NS, 1 << 40)
    assert found[0] == first
    assert _unpacked(found)[wire.AGE_NS] == 1 << 40
    assert found == wire.pack(message | {wire.AGE_NS: 1 << 40})


def _unpacked(data: bytes) -> wire.Message:
    message: wire.Message = msgpack.unpackb(data)
    return message


def test_a_primary_that_asks_who_connects(start_server: StartServer, tmp_path: Path) -> None:
    """The replica's user and password are those of a client; its own clients need none."""
    users = tmp_path / "users"
    users.write_text("site:secret\n")
    password = tmp_path / "password"
    password.write_text("secret\n")
    for path in (users, password):
        path.chmod(0o600)
    primary = start_server("--users", str(users))
    replica = start_server(
        *("--replica-of", primary.endpoint, "--user", "site", "--password-file", str(password))
    )
    own = Credentials(user="site", password="secret")
    with (
        TransformClient.connect(primary.endpoint, timeout_s=10, credentials=own) as writer,
        replica.connect(10) as tf,
    ):
        writer.set_transforms_xact(step(1))
        wait_for_writes(writer, tf)
        assert seen(tf) == 1
