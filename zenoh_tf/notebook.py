"""How notebooks show transforms, arrays and trees: as HTML, which names are escaped for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Final

from zenoh_tf import export
from zenoh_tf.errors import BY_CODE, LookupException, TransformException

if TYPE_CHECKING:
    from zenoh_tf._core import StampedTransform
    from zenoh_tf.array import TransformArray
    from zenoh_tf.introspection.frame_info import FrameInfo
    from zenoh_tf.tree import TransformTree

#: Rows of an array, and frames of a tree.
_MOST_ROWS: Final = 10
_MOST_FRAMES: Final = 100
_HEAD: Final = ("target", "source", "stamp [ns]", "x, y, z [m]", "qx, qy, qz, qw")


def of_stamped(stamped: StampedTransform) -> str:
    """A table of one row; a LatestTransform has its newest stamp as well."""
    head, cells = list(_HEAD), _cells(stamped.stamp_ns, stamped.transform.pose())
    newest_ns = getattr(stamped, "newest_stamp_ns", None)
    if newest_ns is not None:
        head.append("newest [ns]")
        cells.append(str(newest_ns))
    return _table(head, [[stamped.parent_frame, stamped.child_frame, *cells]])


def of_array(array: TransformArray) -> str:
    """A table of the first rows, with the errors of those that failed."""
    rows = []
    for row in range(min(len(array), _MOST_ROWS)):
        code = int(array.status[row])
        cells = _cells(int(array.stamps_ns[row]), array.poses[row])
        if code:
            cells = ["", BY_CODE.get(code, TransformException).__name__, ""]
        rows.append([str(row), *(name or "" for name in array.frames_of(row)), *cells])
    return f"<p>{escape(repr(array))}</p>" + _table(["row", *_HEAD], rows)


def of_tree(tree: TransformTree) -> str:
    """The first frames as `zenoh_tf.export.text` draws them."""
    frames: list[FrameInfo] = []
    for name in sorted(tree.frames())[:_MOST_FRAMES]:
        with contextlib.suppress(LookupException):  # it was removed meanwhile
            frames.append(tree.frame(name))
    return f"<p>{escape(repr(tree))}</p><pre>{escape(export.text(frames))}</pre>"


def _cells(stamp_ns: int, pose: Sequence[float]) -> list[str]:
    numbers = [f"{number:.6g}" for number in pose]
    return [str(stamp_ns), ", ".join(numbers[:3]), ", ".join(numbers[3:])]


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows]
    title = "".join(f"<th>{escape(name)}</th>" for name in head)
    return "<table>" + "".join(f"<tr>{line}</tr>" for line in (title, *lines)) + "</table>"
