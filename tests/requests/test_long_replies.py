"""Replies of many rows, which the server makes and packs off the interpreter's lock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf._core import join_buffers
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf_server.limits import Limits

ROWS = 3000


@pytest.fixture
def tree() -> TransformTree:
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 5, Transform((1, 2, 3))), "test")
    return tree


def lookup(names: list[str], target: Any, source: Any, op: int = wire.OP_LATEST) -> wire.Lookup:
    rows = len(target)
    return wire.Lookup(
        names,
        np.full(rows, op, np.uint8),
        np.asarray(target, np.uint32),
        np.asarray(source, np.uint32),
        np.zeros(rows, np.int64),
    )


def read(tree: TransformTree, asked: wire.Lookup, limits: Limits | None = None) -> Any:
    budget = None if limits is None else limits.budget()
    columns = (asked.names, asked.op, asked.target, asked.source, asked.stamp)
    return tree._read_rows(*columns, budget=budget)


def test_rows_that_fail_and_rows_that_do_not_keep_their_places(tree: TransformTree) -> None:
    names = ["map", "base", *(f"missing {i}" for i in range(ROWS))]
    source = [1 if row % 3 == 0 else 2 + row for row in range(ROWS)]
    asked = lookup(names, np.zeros(ROWS), source)
    reply = wire.lookup_reply(asked, *read(tree, asked))
    packed = wire.pack_in_steps({"v": 1} | reply)
    assert wire.unpack(packed) == wire.unpack(wire.pack({"v": 1} | reply))
    found = wire.parse_lookup_reply(wire.unpack(packed), ROWS)
    for row, (error, stamp_ns, _, pose, _) in enumerate(found.rows()):
        if row % 3 == 0:
            assert (error, stamp_ns, pose[:3]) == (None, 5, (1, 2, 3))
        else:
            assert str(error) == f"frame 'missing {row}' does not exist"
            assert np.isnan(pose).all()


def test_errors_end_where_their_room_ends(tree: TransformTree) -> None:
    asked = lookup(["map", "missing", "gone"], np.zeros(ROWS), [1, 2] * (ROWS // 2))
    status, _, _, _, all_errors, *_ = read(tree, asked)
    assert [row for row, _ in all_errors] == list(range(ROWS))
    status, _, _, _, errors, *_ = read(tree, asked, Limits(error_bytes=10_000))
    assert (status != 0).all()  # also of rows whose error has no room
    assert 10 < len(errors) < 100
    assert [str(each) for each in errors] == [str(each) for each in all_errors[: len(errors)]]
    assert len(read(tree, asked, Limits(error_bytes=0))[4]) == 0


def test_rows_that_fail_alike_share_one_error(tree: TransformTree) -> None:
    asked = lookup(["map", "missing", "gone"], np.zeros(ROWS), [1] * (ROWS - 1) + [2])
    rows = read(tree, asked)
    assert len({id(error) for _, error in rows[4]}) == 2
    encoded = wire.lookup_reply(asked, *rows)["errors"]
    assert encoded[0][1]["facts"]["frame"] == encoded[-2][1]["facts"]["frame"] == "missing"
    assert encoded[-1] == [ROWS - 1, encoded[-1][1]]
    assert encoded[-1][1]["facts"]["frame"] == "gone"


@pytest.mark.parametrize("rows", [1, ROWS])
@pytest.mark.parametrize(
    ("column", "value", "field"),
    [("source", 9, "source"), ("target", 9, "target"), ("op", 77, "op"), ("op", 5, "fixed")],
)
def test_a_malformed_row_is_refused_by_its_field(
    tree: TransformTree, rows: int, column: str, value: int, field: str
) -> None:
    asked = lookup(["map", "base"], np.zeros(rows), np.ones(rows))
    getattr(asked, column)[-1] = value
    for limits in (None, Limits()):
        with pytest.raises(InvalidArgumentException) as raised:
            read(tree, asked, limits)
        assert raised.value.field == field


def test_join_buffers_is_bytes_join() -> None:
    column = np.arange(14, dtype="<f8").reshape(2, 7)
    assert join_buffers([]) == b""
    assert join_buffers([b"ab", column.data, b"", b"c"]) == b"ab" + column.tobytes() + b"c"
    for bad in (["text"], [b"a", 1], [column[:, ::2].data]):
        with pytest.raises((TypeError, BufferError)):
            join_buffers(bad)  # type: ignore[arg-type]


class FrozenCount(ServerProcess):
    """A server that greets with the number of objects that are never collected."""

    START = (
        "-c",
        "import gc, sys; from zenoh_tf_server import main\n"
        "main._greeting = lambda *_: str(gc.get_freeze_count())\n"
        "sys.exit(main.main())",
    )


def test_a_garbage_collection_leaves_out_what_stays(tmp_path: Path) -> None:
    server = FrozenCount(tmp_path / "log", free_endpoint(), "main", ())
    try:
        assert int(server.greeting) > 10_000
    finally:
        server.stop()
