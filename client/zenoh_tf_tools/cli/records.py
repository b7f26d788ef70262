"""Reads the records of all frames, once or for some time."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Final

from zenoh_tf import FrameInfo, LookupException
from zenoh_tf_client import TransformClient

#: Frames of one request.
_FRAMES_AT_ONCE: Final = 1000
#: The pause between two readings: at least so long, and so many times as long as a reading took, so
#: that a large tree's server has time for others.
_PAUSE_S: Final = 0.1
_PAUSES: Final = 4


def frame_infos(tf: TransformClient, names: Sequence[str] | None = None) -> list[FrameInfo]:
    """Return the records of these frames, or of all by name, without those that are removed."""
    if names is None:
        names = sorted(tf.frames())
    found: list[FrameInfo] = []
    for start in range(0, len(names), _FRAMES_AT_ONCE):
        with tf.batch() as batch:
            handles = [batch.frame(name) for name in names[start : start + _FRAMES_AT_ONCE]]
        for handle in handles:
            if not isinstance(handle.exception(), LookupException):
                found.append(handle.result())
    return found


def watch_frames(tf: TransformClient, for_s: float) -> Iterator[list[FrameInfo]]:
    """Yield the records of all frames: at the beginning, at the end, and in between. With 0
    seconds, once."""
    end_s = time.monotonic() + for_s
    while True:
        asked_s = time.monotonic()
        frames = frame_infos(tf)
        took_s = time.monotonic() - asked_s
        yield frames
        left_s = end_s - time.monotonic()
        if left_s <= 0:
            return
        time.sleep(min(max(_PAUSE_S, _PAUSES * took_s), left_s))
