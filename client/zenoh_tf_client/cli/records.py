"""Reads the records of all frames."""

from __future__ import annotations

from typing import Final

from zenoh_tf import FrameInfo, LookupException
from zenoh_tf_client import TransformClient

#: Frames of one request.
_FRAMES_AT_ONCE: Final = 1000


def frame_infos(tf: TransformClient) -> list[FrameInfo]:
    """Return the record of each frame, by name."""
    names = sorted(tf.frames())
    found: list[FrameInfo] = []
    for start in range(0, len(names), _FRAMES_AT_ONCE):
        with tf.batch() as batch:
            handles = [batch.frame(name) for name in names[start : start + _FRAMES_AT_ONCE]]
        for handle in handles:
            # A frame may have been removed since its name was listed.
            if not isinstance(handle.exception(), LookupException):
                found.append(handle.result())
    return found
