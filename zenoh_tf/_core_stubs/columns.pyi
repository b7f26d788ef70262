"""The native module's functions that make the columns of messages: a stub that `_core.pyi` imports,
not a module at run time.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_tf._core_stubs.transform import StampedTransform

class TransformRows:
    """Transforms as columns, a row for each. Each frame's name is there once. The columns never
    change; they are views, and not contiguous."""

    def __init__(  # raises InvalidArgumentException
        self,
        names: Sequence[str],
        parent: NDArray[np.uint32],  # (n,) indexes into names
        child: NDArray[np.uint32],  # (n,)
        stamp_ns: NDArray[np.int64],  # (n,)
        pose: NDArray[np.float64],  # (n, 7) x y z qx qy qz qw of child in parent, metres
    ) -> None: ...
    @staticmethod
    def of(stampeds: Iterable[StampedTransform]) -> TransformRows: ...
    # Of each row: parent, child, stamp in ns, the seven numbers of its pose.
    @staticmethod
    def of_tuples(tuples: Iterable[tuple[str, str, int, Sequence[float]]]) -> TransformRows: ...
    @staticmethod
    def join(parts: Iterable[TransformRows]) -> TransformRows: ...
    # The columns of a message; None if they are malformed.
    @staticmethod
    def parse(
        names: object, parent: object, child: object, stamp: object, pose: object
    ) -> TransformRows | None: ...
    # Some rows, by their numbers; without unused names if these are many.
    def __getitem__(self, rows: slice | NDArray[np.int64]) -> TransformRows: ...
    # Parent, child, stamp and pose as the columns of a message.
    def columns(self) -> tuple[bytes, bytes, bytes, bytes]: ...
    def __len__(self) -> int: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def name_count(self) -> int: ...  # does not make the names of a message
    @property
    def parent(self) -> NDArray[np.uint32]: ...
    @property
    def child(self) -> NDArray[np.uint32]: ...
    @property
    def stamp(self) -> NDArray[np.int64]: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def newest_stamp(self) -> int: ...  # INT64_MIN if there is no row
    @property
    def nbytes(self) -> int: ...  # of rows and names

# Pairs of frames as names (each once) and the columns target, source (rows of names). A single name
# stands for all rows.
def columns_of_pairs(
    targets: str | Sequence[str], sources: str | Sequence[str], rows: int
) -> tuple[list[str], NDArray[np.uint32], NDArray[np.uint32]]: ...

# The rows of messages of puts, decoded without the interpreter lock. None: the message has other
# fields than a put's, or is malformed or beyond a limit; `wire.parse_commit` says which. Anything
# but bytes gives None as well.
def decode_puts(
    messages: list[bytes | None], max_rows: int, max_decoded_bytes: int
) -> list[TransformRows | None]: ...

# A ROS 2 TFMessage in CDR, see `zenoh_tf.ros2.cdr`; of a malformed one the (field, what was
# expected). If `rename` gives two frames one name, the rows have it twice.
def decode_tf_message(
    message: bytes, rename: Callable[[list[str]], list[str]] | None = None
) -> TransformRows | tuple[str, str]: ...

# The rows of many messages, the number of malformed ones, which have no rows, and the (field, what
# was expected) of the first of these.
def decode_tf_messages(messages: list[bytes]) -> tuple[TransformRows, int, str, str]: ...
