"""An example of every message of the protocol: how the code of today writes it, and reads it.

    python -m tests.requests.golden

adds the messages that `golden_v{N}.json` lacks, where N is the version of the protocol. It never
changes one that is there: those are the bytes that clients and servers of this version exchange.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from zenoh_tf import Estimate, StampedTransform, Transform, TransformTree, wire
from zenoh_tf._core import Changes, Frames, TransformRows, reply_to_lookup
from zenoh_tf._net import keys
from zenoh_tf.errors import BY_CODE, FACTS, TransformException
from zenoh_tf.estimate import estimate_of
from zenoh_tf.introspection.frame_info import AuthorityInfo, ClientInfo, FrameInfo
from zenoh_tf.wire.samples import NO_PARENT
from zenoh_tf_client.session.server_info import parse_server_info

from .golden_records import (
    AUTHORITY,
    CLIENT,
    ESTIMATE,
    ESTIMATE_COLUMNS,
    ESTIMATES,
    FRAME_RECORDS,
    FRAMES,
    HELLO,
    INSTANCE,
    NAMES,
)

Read = Callable[[bytes], Any]

ID = bytes(range(16))
ROWS = TransformRows.of_tuples(
    [
        ("map", "base", 7, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)),
        ("base", "ärm/1", -8, (0.5, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)),
    ]
)
EVERY_OPTION = wire.Lookup(
    NAMES,
    np.array([wire.OP_FULL, wire.OP_LATEST], np.uint8),
    np.array([0, 1], np.uint32),
    np.array([1, 0], np.uint32),
    np.array([5, wire.NO_STAMP]),
    np.array([2, 0], np.uint32),
    np.array([6, wire.NO_STAMP]),
    atomic=True,
    versions=True,
    errors=False,
    timeout_ns=8,
)
INTEREST = wire.Interest.of([("map", "base"), ("ärm/1", "base")], 100, 5)
WRITE = {"id": ID, "expires_ns": 1 << 40, "instance": INSTANCE}
SETTINGS = wire.TreeSettings(10_000_000_000, 1000, 100, 255, 0)
LIMITS = wire.TreeSettings(10**10, 1000, 100, 255, 0, {"base": (1.0, 2.5, 0.0, 4.0, 0.5)})
LIMITED = wire.SnapshotPlan(9, True, np.array([0, 5, 9], np.uint32), LIMITS, 1 << 40)
#: Of errors that are newer than the first of them.
NEW_FACTS = {"error_m": 0.5, "error_rad": 0.25, "by_ns": 3}
FACT_VALUES = {
    name: 2.5 if name == "value" else 3 for name in FACTS if name not in NEW_FACTS
} | dict.fromkeys([name for name in FACTS if name.endswith(("frame", "root", "field"))], "map")

#: A change of every kind. Two samples of one commit have one version.
CHANGES = wire.pack(
    {
        "names": NAMES,
        "authorities": ["", "lidar"],
        "kind": bytes([0, 0, 1, 2, 3, 4, 5, 6]),
        "frame": np.array([1, 1, 2, 0, 1, 2, 0, 1], np.uint32).tobytes(),
        "version": np.array([4, 4, 8, 8, 12, 12, 16, 20], np.uint64).tobytes(),
        "parent": np.array([0, 0, NO_PARENT], np.uint32).tobytes(),
        "authority": np.array([0, 0, 1], np.uint32).tobytes(),
        "stamp": np.array([7, 8, 0]).tobytes(),
        "pose": np.arange(21, dtype=float).tobytes(),
        "lost": np.array([NO_PARENT], np.uint32).tobytes(),
    }
)


def reply(fields: wire.Message) -> bytes:
    """A reply with the fields that each has."""
    return wire.pack(fields | {"v": wire.VERSION, "instance": INSTANCE})


def read(parse: Callable[..., Any], *arguments: Any) -> Read:
    """The reader of a message from its map."""
    return lambda data: parse(wire.unpack(data), *arguments)


def read_value(kind: type, parse: Callable[[Any], Any] = lambda value: value) -> Read:
    return lambda data: parse(wire.parse_value(wire.unpack(data), kind))


def read_estimate(value: Any) -> Any:
    """An estimate with its pose as numbers, which JSON can hold."""
    found = estimate_of(value)
    fields = {name: getattr(found, name) for name in Estimate.__match_args__}
    return fields | {"transform": found.transform.pose()}


def call(what: str, **arguments: Any) -> tuple[Callable[[], bytes], Read]:
    return lambda: wire.pack(wire.call_body(what, **arguments)), wire.unpack


def read_write(data: bytes) -> Any:
    message = wire.unpack(data)
    return wire.parse_write(message), wire.parse_commit(message)


def read_batch(data: bytes) -> Any:
    message = wire.unpack(data)
    return wire.parse_write(message), [list(each) for each in wire.parse_batch(message)]


def lookup_reply() -> wire.Message:
    error = BY_CODE[9]("too late", frame="base", stamp_ns=9)
    return wire.lookup_reply(
        EVERY_OPTION,
        np.array([0, 9], np.uint8),
        np.array([5, 0]),
        np.array([0, 0]),
        np.array([range(7), [np.nan] * 7], float),
        reads=(["base", "map"], np.array([4, 0], np.uint64)),
    ) | {"errors": [[1, wire.encode_error(error)]]}


def commit() -> wire.Message:
    commit = wire.Commit(ROWS, "lidar/1", True, True, True, ["base"], np.array([4], np.uint64))
    return wire.commit_body(commit) | WRITE


def native_reply() -> bytes:
    """To "lookup of one row", by the code that answers most of them."""
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 7, Transform((1.0, 2.0, 3.0))))
    data = reply_to_lookup(tree, wire.pack_one_read("map", "base", wire.OP_AT, 7), INSTANCE)
    assert data is not None
    return data


def batch_reply() -> bytes:
    stored = {"stored": b"\1", "seq": 9}
    failed = {"error": wire.encode_error(BY_CODE[11]("too much", field="reply_bytes"))}
    return wire.batch_reply([wire.pack(part) for part in (stored, failed)], INSTANCE)


#: By name: what writes the message, and what reads it.
MESSAGES: dict[str, tuple[Callable[[], bytes], Read]] = {
    "lookup of one row": (
        lambda: wire.pack_one_read("map", "base", wire.OP_AT, 7),
        read(wire.parse_lookup),
    ),
    "lookup with all options": (
        lambda: wire.pack(wire.lookup_body(EVERY_OPTION)),
        read(wire.parse_lookup),
    ),
    "lookup that must see a commit": (
        lambda: wire.pack(
            wire.one_read("map", "base", 1, wire.NO_STAMP) | wire.floor_field(INSTANCE, 9)
        ),
        read(wire.take_floor),
    ),
    "commit": (lambda: wire.pack(wire.commit_body(wire.Commit(ROWS))), read_write),
    "commit with all options": (lambda: wire.pack(commit()), read_write),
    "batch": (
        lambda: wire.pack(
            wire.batch_body(
                [
                    ("lookup", wire.one_read("map", "base", wire.OP_COMMON, wire.NO_STAMP)),
                    ("commit", wire.commit_body(wire.Commit(ROWS))),
                    ("info", wire.call_body("stats")),
                ]
            )
            | WRITE
        ),
        read_batch,
    ),
    "hello": call("hello", user="ann", client="a1b2", clock_ns=1 << 60, round_trip_ns=2000),
    "info frames": call("frames", limit=2, after=1),
    "info frame": call("frame", frame="base"),
    "info ancestors": call("ancestors", target="map", source="base", stamp_ns=7),
    "info authorities": call("authorities"),
    "info clients": call("clients"),
    "info parent": call("parent", frame="base"),
    "info chain": call("chain", target="map", source="base"),
    "info velocity": call(
        "velocity",
        tracking_frame="base",
        observation_frame="map",
        averaging_interval_ns=10,
        reference_point=wire.raw(np.array([1.0, 2.0, 3.0]), wire.F64),
    ),
    "info estimate": call(
        "estimate", target="map", source="base", level=0.9, max_by_ns=500_000_000, radius_m=0.5
    ),
    "info estimates": (
        lambda: wire.pack(wire.estimates_body(ESTIMATES)),
        read(wire.parse_estimates),
    ),
    "info stats": call("stats"),
    "info cancel": call("cancel", wait_ids=wire.raw(np.array([1, 2]), wire.I64)),
    "admin clear": (
        lambda: wire.pack(wire.call_body("clear", keep_static=False) | WRITE),
        wire.unpack,
    ),
    "admin reset": call("reset"),
    "admin remove_frame": call("remove_frame", name="base", subtree=True),
    "snapshot": (
        lambda: wire.pack(wire.snapshot_request(None)),
        read(wire.parse_snapshot_request),
    ),
    "snapshot of a piece": (
        lambda: wire.pack(wire.snapshot_request(wire.SnapshotRequest(INSTANCE, 1, 10, 20))),
        read(wire.parse_snapshot_request),
    ),
    "snapshot of an interest": (
        lambda: wire.pack(wire.snapshot_request(None, INTEREST)),
        read(wire.parse_interest),
    ),
    "missed": (
        lambda: wire.pack(wire.missed_request(INSTANCE, 5)),
        read(wire.parse_missed_request),
    ),
    "missed of an interest": (
        lambda: wire.pack(wire.missed_request(INSTANCE, 5, INTEREST)),
        read(wire.parse_missed_request),
    ),
    "reply to a lookup": (lambda: reply(lookup_reply()), read(wire.parse_lookup_reply, 2)),
    "reply to a lookup, by the native path": (native_reply, read(wire.parse_one_answer)),
    "reply to a lookup of one row": (
        lambda: reply(wire.one_answer(7, 9, (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0))),
        read(wire.parse_one_answer),
    ),
    "reply of a replica": (
        lambda: reply({"value": None, "seq": 9, wire.AGE_NS: 1000}),
        read(wire.parse_age_s),
    ),
    "reply to a commit": (
        lambda: reply({"stored": b"\1\0", "seq": 9}),
        read(wire.parse_commit_reply, 2),
    ),
    "reply to a batch": (batch_reply, read(wire.parse_batch_reply, 2)),
    "reply to hello": (
        lambda: reply({"value": HELLO}),
        read_value(dict, lambda value: parse_server_info(value, 1 << 30)),
    ),
    "reply to info frames": (lambda: reply({"value": NAMES, "next": 17}), read_value(list)),
    **{
        name: (partial(reply, {"value": record}), read_value(dict, FrameInfo.from_record))
        for name, record in FRAME_RECORDS.items()
    },
    "reply to info authorities": (
        lambda: reply({"value": [AUTHORITY]}),
        read_value(list, lambda value: [AuthorityInfo(**record) for record in value]),
    ),
    "reply to info clients": (
        lambda: reply({"value": [CLIENT]}),
        read_value(list, lambda value: [ClientInfo(**record) for record in value]),
    ),
    "reply to info estimate": (
        lambda: reply({"value": ESTIMATE}),
        read_value(dict, read_estimate),
    ),
    "reply to info estimates": (
        lambda: reply({"value": wire.estimates_value(ESTIMATE_COLUMNS)}),
        read(wire.parse_estimates_reply, 2),
    ),
    "reply to an admin request": (
        lambda: reply({"value": None, "seq": 9}),
        read_value(type(None)),
    ),
    "snapshot's plan": (
        lambda: reply(
            wire.snapshot_plan_reply(
                wire.SnapshotPlan(9, True, np.array([0, 5, 9], np.uint32), SETTINGS, 1 << 40)
            )
        ),
        read(wire.parse_snapshot_plan),
    ),
    "snapshot's plan with limits of motion": (
        lambda: reply(wire.snapshot_plan_reply(LIMITED)),
        read(wire.parse_snapshot_plan),
    ),
    "snapshot's plan of an interest": (
        lambda: reply(
            wire.snapshot_plan_reply(
                wire.SnapshotPlan(9, True, wire.NO_BOUNDS, SETTINGS, 1 << 40, CHANGES)
            )
        ),
        read(wire.parse_snapshot_plan),
    ),
    "snapshot's piece": (
        lambda: reply(wire.snapshot_piece_reply(wire.SnapshotPiece(1, 15, 9, FRAMES))),
        read(wire.parse_snapshot_piece),
    ),
    "changes in a stream": (lambda: CHANGES, Changes),
    "frames in a snapshot's piece": (lambda: FRAMES, Frames),
    "reply to missed": (
        lambda: reply(wire.missed_reply([b"\x81\xa1v\x01"], 9)),
        read(wire.parse_missed_reply),
    ),
    "stream": (
        lambda: wire.pack(wire.stream_body(wire.StreamMessage(INSTANCE, 5, 9, 1 << 40, CHANGES))),
        read(wire.parse_stream),
    ),
    "stream's heartbeat": (
        lambda: wire.pack(wire.stream_body(wire.StreamMessage(INSTANCE, 10, 9, 1 << 40))),
        read(wire.parse_stream),
    ),
    "attachment": (f"a1b2 {keys.TAKES_PARTS}".encode, bytes.decode),
}


def _add_errors() -> None:
    for code, kind in BY_CODE.items():
        facts = {1: FACT_VALUES, 21: {"frame": "map"} | NEW_FACTS}.get(code, {"frame": "map"})
        error = kind("why", **facts)

        def write(error: TransformException = error) -> bytes:
            return wire.pack(wire.error_reply(INSTANCE, error))

        MESSAGES[f"error {code}"] = write, read(lambda body: wire.decode_error(body["error"]))


_add_errors()


COLUMNS: dict[type, str] = {
    Changes: "names authorities kind frame version parent authority stamp pose lost",
    Frames: "names authorities frame version static authority count stamp parent pose",
}


def plain(value: Any) -> Any:
    """What was read, as JSON can hold it."""
    for kind, columns in COLUMNS.items():
        if isinstance(value, kind):
            return [plain(getattr(value, name)) for name in columns.split()]
    if isinstance(value, TransformRows):
        return [value.names, *(plain(getattr(value, each)) for each in (
            "parent", "child", "stamp", "pose",
        ))]  # fmt: skip
    if isinstance(value, np.ndarray):
        return [value.dtype.str, [repr(each) for each in value.ravel().tolist()]]
    if isinstance(value, TransformException):
        return [type(value).__name__, value.code, str(value), value.facts]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {each.name: plain(getattr(value, each.name)) for each in fields}
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return value.hex() if isinstance(value, bytes) else value


def file(version: int) -> Path:
    return Path(__file__).with_name(f"golden_v{version}.json")


def stored(version: int) -> dict[str, Any]:
    """By name: the bytes of a version's messages in hexadecimal, and what is read from them."""
    found: dict[str, Any] = json.loads(file(version).read_text())
    return found


def main() -> None:
    path = file(wire.VERSION)
    known = stored(wire.VERSION) if path.exists() else {}
    for name, (write, parse) in MESSAGES.items():
        if name not in known:
            data = write()
            known[name] = {"bytes": data.hex(), "read": plain(parse(data))}
            print("added", name)
    path.write_text(json.dumps(known, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
