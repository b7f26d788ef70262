"""Gathers the facts that the doctor judges about a server's tree."""

from __future__ import annotations

import sys
import time
from typing import Final

from zenoh_tf import LimitExceeded, TimeoutException
from zenoh_tf.doctor import LinkFacts, TreeFacts
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.records import frame_infos
from zenoh_tf_tools.tree_observer import TreeObserver

#: How often what has come is read.
_PAUSE_S: Final = 0.05


def observe(tf: TransformClient, observe_s: float, timeout_s: float) -> TreeFacts:
    """Watch the samples for so many seconds, and read the records of the frames at the beginning
    and at the end. The first copy of the tree may take `timeout_s`."""
    observer = _observer(tf, timeout_s)
    try:
        before = {frame.name: frame for frame in frame_infos(tf)}
        authorities_before = tf.authorities()
        start_s = time.monotonic()
        while (left_s := start_s + observe_s - time.monotonic()) > 0:
            if observer is not None:
                observer.update()
            time.sleep(min(_PAUSE_S, left_s))
        observed_s = time.monotonic() - start_s if observe_s else 0.0
        frames = frame_infos(tf)
        now_ns = time.time_ns() if observer is None else observer.update()
    finally:
        if observer is not None:
            observer.close()
    seen = {} if observer is None else observer.observation.seen()
    return TreeFacts(
        [LinkFacts(frame, before.get(frame.name), seen.get(frame.name)) for frame in frames],
        now_ns,
        observed_s,
        tf.authorities(),
        authorities_before if observe_s else (),
        tf.clients(),
    )


def _observer(tf: TransformClient, timeout_s: float) -> TreeObserver | None:
    """What sees the samples; None if the tree is too large to be sent in time."""
    try:
        return TreeObserver(tf, timeout_s)
    except (LimitExceeded, TimeoutException) as error:
        print(
            f"zenoh-tf: samples are not judged, only the records of frames: {error}",
            file=sys.stderr,
        )
        return None
