"""Stores the last poses of chosen dynamic frames: a thread reads them once a second.

Thread safety: all methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from zenoh_tf import TransformTree
from zenoh_tf.errors import TransformException
from zenoh_tf.threads import Periodic

from .file import Changes, Stored, StoredLink, Table
from .static_links import StaticLinks
from .writer import STORE_TIMEOUT_S, StateWriter

_PERIOD_S: Final = 1.0


class LastPoses:
    """Follows the newest samples of some frames."""

    def __init__(
        self,
        tree: TransformTree,
        frames: Sequence[str],
        links: StaticLinks,
        writer: StateWriter,
        stored: Stored,
    ) -> None:
        self._tree = tree
        self._frames = frames
        self._links = links
        self._writer = writer
        self._stored: dict[str, StoredLink] = dict(stored.last_poses)
        # Frames that are no longer to be remembered.
        self._put({frame: None for frame in self._stored.keys() - set(frames)})
        self._thread = Periodic("last poses", self._store, _PERIOD_S, at_end=True)
        self._thread.start()

    def close(self) -> None:
        """Store the poses once more, and end the thread."""
        self._thread.close(STORE_TIMEOUT_S)

    def _store(self) -> None:
        with self._links.lock:  # so that no pose is stored after its frame was removed
            poses = {frame: self._newest(frame) for frame in self._frames}
            self._put({f: link for f, link in poses.items() if link != self._stored.get(f)})

    def _put(self, changed: dict[str, StoredLink | None]) -> None:
        if not changed:
            return
        changes: Changes = {(Table.LAST_POSES, frame): link for frame, link in changed.items()}
        for frame, link in changed.items():
            if link is None:
                self._stored.pop(frame, None)
            else:
                self._stored[frame] = link
        self._writer.put(changes)

    def _newest(self, frame: str) -> StoredLink | None:
        """The newest sample of a frame; None if it has none, or a static link."""
        try:
            while True:
                record = self._tree._frame_record(frame)
                parent = record["parent"]
                if parent is None or record["static"]:
                    return None
                found = self._tree.lookup_latest_transform(parent, frame)
                if self._tree._frame_record(frame)["parent"] == parent:
                    pose = tuple(float(value) for value in found.transform.pose())
                    return StoredLink(parent, found.newest_stamp_ns, pose, record["authority"])
        except TransformException:  # unknown, or it changed between the calls
            return None
