"""Gathers the facts that the doctor judges about a server's tree."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Generator
from typing import Final

from zenoh_tf import LimitExceeded, TimeoutException
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.records import frame_infos
from zenoh_tf_tools.doctor import LinkFacts, TreeFacts
from zenoh_tf_tools.tree_observer import TreeObserver

#: How often what has come is read.
_PAUSE_S: Final = 0.05
#: A tree that is watched on and on is judged over at most about so much time.
_WINDOW_S: Final = 15.0


def observe(tf: TransformClient, observe_s: float, timeout_s: float) -> TreeFacts:
    """Watch the samples for so many seconds, and read the records of the frames at the beginning
    and at the end. The first copy of the tree may take `timeout_s`."""
    with contextlib.closing(watch(tf, observe_s, timeout_s)) as looks:
        return next(looks)


def watch(
    tf: TransformClient, observe_s: float, timeout_s: float
) -> Generator[TreeFacts, None, None]:
    """Watch the samples from now on, until the iterator is closed.

    Yields what `observe` returns. The next facts are of a time that has grown, or of one that
    begins with the last facts if that time is longer than `_WINDOW_S`. The tree is copied once, and
    again only after a break of the stream.
    """
    observer = _observer(tf, timeout_s)
    try:
        window = _TimeWindow(tf)
        while True:
            while (left_s := window.start_s + observe_s - time.monotonic()) > 0:
                if observer is not None:
                    observer.update()
                time.sleep(min(_PAUSE_S, left_s))
            yield window.facts(observer, observed=observe_s > 0)
            if observer is not None and observer.is_broken:
                observer.close()
                observer = _observer(tf, timeout_s)
            elif time.monotonic() < window.start_s + _WINDOW_S:
                continue
            elif observer is not None:
                observer.renew()
            window = _TimeWindow(tf)
    finally:
        if observer is not None:
            observer.close()


class _TimeWindow:
    """The records of a tree at the beginning of a time."""

    def __init__(self, tf: TransformClient) -> None:
        self._tf = tf
        self._frames = {frame.name: frame for frame in frame_infos(tf)}
        self._authorities = tf.authorities()
        self.start_s = time.monotonic()

    def facts(self, observer: TreeObserver | None, *, observed: bool) -> TreeFacts:
        """What is known now. `observed`: whether time has passed since the beginning."""
        observed_s = time.monotonic() - self.start_s if observed else 0.0
        frames = frame_infos(self._tf)
        now_ns = time.time_ns() if observer is None else observer.update()
        seen = {} if observer is None else observer.observation.seen()
        return TreeFacts(
            [LinkFacts(x, self._frames.get(x.name), seen.get(x.name)) for x in frames],
            now_ns,
            observed_s,
            self._tf.authorities(),
            self._authorities if observed else (),
            self._tf.clients(),
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
