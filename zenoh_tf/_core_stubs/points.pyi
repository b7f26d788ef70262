"""The native module's kernels over arrays of points: a stub that `_core.pyi` imports, not a module at
run time. Points and `out` are float32 or float64, (rows, columns, 3), with any strides; see
zenoh_tf.clouds.points.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

def deskew_by_samples(
    points: NDArray[Any],
    stamps_ns: NDArray[np.int64],  # (rows, columns)
    out: NDArray[Any],
    times: NDArray[np.int64],  # ascending; all stamps are among them
    poses: NDArray[np.float64],  # (n, 7), X_fixed_source at each of the times
    at: Sequence[float],  # (7,), X_fixed_source at the time to move the points to
) -> None: ...
def map_rows(
    poses: NDArray[np.float64],  # (rows, 7), one for each row of points
    points: NDArray[Any],
    out: NDArray[Any],
) -> None: ...
