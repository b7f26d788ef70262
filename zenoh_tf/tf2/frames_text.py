"""The contents of the tree as text, in the two formats of tf2's buffer."""

from __future__ import annotations

import json
from collections.abc import Iterable

from zenoh_tf import FrameInfo

#: tf2 counts a shorter history as this long, so a single sample has a rate of 10 kHz.
_SHORTEST_NS = 100_000


def as_yaml(frames: Iterable[FrameInfo]) -> str:
    """Return one YAML map per frame that has a parent, with tf2's keys; seconds and hertz."""
    return "".join(_yaml(link) for link in frames if link.parent is not None) or "[]"


def as_string(frames: Iterable[FrameInfo]) -> str:
    """Return one sentence per frame that has a parent."""
    return "".join(
        f"Frame {link.name} exists with parent {link.parent}.\n"
        for link in frames
        if link.parent is not None
    )


def _yaml(link: FrameInfo) -> str:
    if link.static:
        oldest_ns = newest_ns = 0  # A static link holds at all times, which tf2 writes as 0.
    else:
        oldest_ns, newest_ns = link.oldest_stamp_ns or 0, link.newest_stamp_ns or 0
    span_ns = newest_ns - oldest_ns
    # A JSON string is a YAML string, whatever characters a name has.
    return (
        f"{json.dumps(link.name)}:\n"
        f"  parent: {json.dumps(link.parent)}\n"
        f"  broadcaster: {json.dumps(link.authority)}\n"
        f"  rate: {link.samples * 1e9 / max(span_ns, _SHORTEST_NS):.3f}\n"
        f"  most_recent_transform: {newest_ns / 1e9:.6f}\n"
        f"  oldest_transform: {oldest_ns / 1e9:.6f}\n"
        f"  buffer_length: {span_ns / 1e9:.3f}\n"
    )
