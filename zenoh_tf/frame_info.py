"""What the tree knows about one frame."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FrameInfo:
    """A frame and the link to its parent, as of one instant.

    ``parent`` is ``None`` for a root, and the stamps are ``None`` where there is no data.
    A static link has one sample, good for all times. The counters: samples ``rewritten`` at an
    equal stamp, ``dropped`` as too old, ``evicted`` before their time because the frame was
    full; times the newest link was ``reparented``, ``switched`` between static and dynamic,
    taken over by another authority (``authority_changes``).
    """

    name: str
    parent: str | None
    authority: str
    static: bool
    samples: int
    oldest_stamp_ns: int | None
    newest_stamp_ns: int | None
    version: int
    rewritten: int
    dropped: int
    evicted: int
    reparented: int
    switched: int
    authority_changes: int

    @property
    def rate_hz(self) -> float | None:
        """Samples over the time between oldest and newest, as tf2 counts; ``None``: no rate."""
        if self.static or self.oldest_stamp_ns is None or self.newest_stamp_ns is None:
            return None
        span_ns = self.newest_stamp_ns - self.oldest_stamp_ns
        return self.samples * 1e9 / span_ns if span_ns > 0 else None
