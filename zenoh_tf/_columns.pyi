"""The native module's functions that make the columns of messages: a stub that `_core.pyi` imports,
not a module at run time.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_tf._transform import StampedTransform

# Transforms as names (each once) and the columns parent, child (rows of names), stamp_ns, pose.
def columns_of(
    stampeds: Sequence[StampedTransform],
) -> tuple[
    list[str],
    NDArray[np.uint32],
    NDArray[np.uint32],
    NDArray[np.int64],
    NDArray[np.float64],
]: ...

# Pairs of frames as names (each once) and the columns target, source (rows of names). A single name
# stands for all rows.
def columns_of_pairs(
    targets: str | Sequence[str], sources: str | Sequence[str], rows: int
) -> tuple[list[str], NDArray[np.uint32], NDArray[np.uint32]]: ...

# A ROS 2 TFMessage in CDR as (names, parent, child, stamp_ns, pose), see `zenoh_tf.ros2.cdr`; of a
# malformed one the (field, what was expected).
def decode_tf_message(message: bytes) -> tuple[Any, ...]: ...

# The same of many messages, with the number of malformed ones, which have no rows, and the (field,
# what was expected) of the first of these.
def decode_tf_messages(
    messages: list[bytes],
) -> tuple[
    list[str],
    NDArray[np.uint32],
    NDArray[np.uint32],
    NDArray[np.int64],
    NDArray[np.float64],
    int,
    str,
    str,
]: ...
