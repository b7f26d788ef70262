"""The tree's static links: which there are, who may announce them again, and what is stored.

Every change of a static link goes through this class, under one lock. So the state file gets the
changes in the order in which the tree has seen them. Dynamic commits acquire no lock here, unless
one makes a static link dynamic.

Thread safety: all methods.
Invariant: `_names` has at least all frames with a static link.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformTree, admission, wire
from zenoh_tf.errors import (
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    TransactionConflict,
)

from ..limits import Limits
from ..rate_limited_log import RateLimitedLog
from .file import Changes, Stored, StoredLink, Table
from .writer import StateWriter

#: How often an announcement is tried that meets other commits of the same frames.
_ANNOUNCE_ATTEMPTS: Final = 5
#: The number of the state write of a change that stores nothing.
NO_STATE_WRITE: Final = 0


class StaticLinks:
    """Commits and removes static links. What needs storing has a number for `wait`."""

    def __init__(
        self,
        tree: TransformTree,
        limits: Limits,
        writer: StateWriter | None,
        stored: Stored,
    ) -> None:
        """`stored`: what the tree was restored from."""
        self._tree = tree
        self._limits = limits
        self._writer = writer
        self._lock = threading.Lock()
        self._names = set(stored.static_links)
        # Those of them that a call has set. No announcement replaces them: a call is a correction,
        # and whoever announces does not know of it.
        self._by_call = {name for name, link in stored.static_links.items() if link.by_call}
        self._announced: set[str] = set()  # those whose link an announcement has stored
        # Frames whose static link was removed, by the number of the removal; oldest first.
        self._removed = OrderedDict(stored.removed_links)
        self._last_removal = max(self._removed.values(), default=0)
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.state"))
        #: Grows with every change of a static link.
        self.changes = 0
        #: False: nothing is stored, and dynamic commits need no call of `made_dynamic`.
        self.has_state_file = writer is not None

    def commit(self, commit: wire.Commit, *, by_call: bool) -> tuple[bytes, int]:
        """Commit static transforms. Returns a byte for each row (zenoh_tf.admission; 0: an
        announcement that is left out), and the number of the state write.

        An announcement stores a row only if its frame has no link and none was removed, or has a
        static link that the same authority has published, or another one has announced with an
        older stamp: in which order broadcasters announce to a new server is chance.

        Args:
            commit: The transforms.
            by_call: They come from a call, not from a put.

        Raises:
            TransformException: The commit is rejected.
        """
        with self._lock:
            if commit.announce:
                return self._announce(commit)
            return self._commit(commit, by_call=by_call)

    def made_dynamic(self, commit: wire.Commit) -> int:
        """Follow a dynamic commit that the tree has applied. Returns the number of its state
        write: NO_STATE_WRITE unless a static link became dynamic."""
        # A static commit adds its names before the tree applies it. So if the tree has applied
        # this commit after a static one, the name is found here.
        if self._names.isdisjoint(commit.rows.names):
            return NO_STATE_WRITE
        children = {commit.rows.names[index] for index in commit.rows.child.tolist()}
        if children.isdisjoint(self._names):
            return NO_STATE_WRITE
        with self._lock:
            switched = [name for name in children & self._names if not self._is_static(name)]
            self.changes += bool(switched)
            self._drop_names(switched)
            return self._put({(Table.STATIC_LINKS, name): None for name in switched})

    # The next three return the number of the state write, and raise TimeoutException if they could
    # begin only after `expires_ns` of the monotonic clock.

    def clear(self, keep_static: bool, expires_ns: int) -> int:
        """Drop all samples, and static links unless they are kept."""
        with self._lock:
            self._tree._clear(keep_static, expires_ns)
            self.changes += 1
            gone = [] if keep_static else list(self._names)
            return self._put(self._forget(gone))

    def reset(self, expires_ns: int) -> int:
        """Drop every frame, and what is known of removed links."""
        with self._lock:
            self._tree._reset(expires_ns)
            self.changes += 1
            changes: Changes = {(Table.STATIC_LINKS, name): None for name in self._names}
            # The tree is as new: every broadcaster may announce its links to the next server.
            changes |= {(Table.REMOVED_LINKS, name): None for name in self._removed}
            self._names.clear()
            self._by_call.clear()
            self._announced.clear()
            self._removed.clear()
            return self._put(changes)

    def remove_frame(self, name: str, subtree: bool, expires_ns: int) -> int:
        """Remove a frame, or all frames below it as well.

        Raises:
            TransformException: The frame cannot be removed.
        """
        with self._lock:
            before = list(self._names)
            self._tree._remove_frame(name, subtree, expires_ns)
            self.changes += 1
            gone = self._missing(before) if subtree else self._names & {name}
            return self._put(self._forget(list(gone)))

    def records(self) -> list[dict[str, Any]]:
        """The records of all frames with a static link."""
        with self._lock:
            names = list(self._names)
        records = [record for name in names if (record := self._record(name)) is not None]
        return [record for record in records if record["static"] and record["parent"] is not None]

    def is_static_of(self, frame: str, authority: str) -> bool:
        """True if a frame has a static link, and an authority has set it last, by a put."""
        with self._lock:
            record = self._record(frame)
            return (
                record is not None
                and bool(record["static"])
                and record["authority"] == authority
                and frame not in self._by_call
            )

    def has_link(self, frame: str) -> bool:
        """True if a frame has a parent."""
        with self._lock:
            record = self._record(frame)
            return record is not None and record["parent"] is not None

    def is_set_by_call(self, frame: str) -> bool:
        """True if a call has set a frame's static link last: a correction, which no announcement
        replaces."""
        with self._lock:
            return frame in self._by_call

    def wait(self, state_write: int) -> None:
        """Wait until a change is durable; not at all for NO_STATE_WRITE.

        Raises:
            NotDurable: It was applied, but cannot be stored now.
        """
        if state_write != NO_STATE_WRITE and self._writer is not None:
            self._writer.wait(state_write)

    def counters(self) -> dict[str, int]:
        """Counters for `stats`: what is not stored yet, because of the disk for instance."""
        return {} if self._writer is None else {"state_pending": self._writer.pending}

    # --- the rest requires the lock

    def _commit(self, commit: wire.Commit, *, by_call: bool) -> tuple[bytes, int]:
        links = _last_links(commit, by_call=by_call)
        new = links.keys() - self._names
        self._names |= new
        try:
            stored = commit.apply(self._tree)
        except BaseException:
            self._names -= new
            raise
        if commit.drop_bad and stored.count(admission.STORED) != len(stored):
            rows = np.frombuffer(stored, np.uint8) == admission.STORED
            links = _last_links(replace(commit, rows=commit.rows[rows.nonzero()[0]]), by_call=False)
            self._names -= new - links.keys()
        self.changes += 1
        if by_call:
            self._by_call.update(links)
        else:
            self._by_call.difference_update(links)
        if commit.announce:
            self._announced.update(links)
        else:
            self._announced.difference_update(links)
        changes: Changes = {(Table.STATIC_LINKS, child): link for child, link in links.items()}
        for child in self._removed.keys() & links.keys():
            del self._removed[child]
            changes[Table.REMOVED_LINKS, child] = None
        return stored, self._put(changes)

    def _announce(self, commit: wire.Commit) -> tuple[bytes, int]:
        """Announce links in one commit."""
        stored = np.zeros(len(commit.rows), np.uint8)
        rows = np.arange(len(commit.rows))
        for attempt in range(_ANNOUNCE_ATTEMPTS):
            versions = [self._announceable(commit, int(row)) for row in rows]
            may = np.array([version is not None for version in versions])
            chosen = rows[may]
            self._log_left_out(commit, rows[~may])
            if not chosen.size:
                break
            part = replace(
                commit,
                rows=commit.rows[chosen],
                # The commit fails if another one changes one of the frames before it.
                read_names=[commit.rows.names[commit.rows.child[row]] for row in chosen],
                read_versions=np.array([v for v in versions if v is not None], np.uint64),
            )
            try:
                outcome, state_write = self._commit(part, by_call=False)
            except TransactionConflict:
                if attempt + 1 == _ANNOUNCE_ATTEMPTS:
                    raise
                continue
            stored[chosen] = np.frombuffer(outcome, np.uint8)
            return stored.tobytes(), state_write
        return stored.tobytes(), NO_STATE_WRITE

    def _announceable(self, commit: wire.Commit, row: int) -> int | None:
        """The frame's version if the row may be stored, else None."""
        child = commit.rows.names[commit.rows.child[row]]
        if child in self._removed:
            return None
        record = self._record(child)
        if record is None:
            return 0  # the version of a frame that does not exist
        is_own = record["authority"] == commit.authority and child not in self._by_call
        is_newer = (
            child in self._announced and int(commit.rows.stamp[row]) > record["newest_stamp_ns"]
        )
        may = record["parent"] is None or (record["static"] and (is_own or is_newer))
        version: int = record["version"]
        return version if may else None

    def _log_left_out(self, commit: wire.Commit, rows: NDArray[np.int64]) -> None:
        if rows.size:
            first = commit.rows.names[commit.rows.child[rows[0]]]
            self._log.warn(
                f"statics of {commit.authority!r}",
                f"announced again, but {rows.size} left out, {first!r} first: they were changed by "
                "a call or another authority, or removed, since",
            )

    def _record(self, frame: str) -> dict[str, Any] | None:
        try:
            return self._tree._frame_record(frame)
        except (LookupException, InvalidArgumentException, LimitExceeded):  # or no valid name
            return None

    def _missing(self, frames: list[str]) -> set[str]:
        """Those of some frames that do not exist."""
        status, *_ = self._tree._lookup_columns(frames, frames, None)
        return {frame for frame, code in zip(frames, status.tolist(), strict=True) if code}

    def _is_static(self, frame: str) -> bool:
        record = self._record(frame)
        return record is not None and bool(record["static"])

    def _forget(self, names: list[str]) -> Changes:
        """Record that static links were removed. Returns what to store."""
        changes: Changes = {}
        for name in names:
            changes[Table.STATIC_LINKS, name] = None
            self._last_removal += 1
            self._removed[name] = changes[Table.REMOVED_LINKS, name] = self._last_removal
            self._removed.move_to_end(name)
        self._drop_names(names)
        while len(self._removed) > self._limits.removed_statics:
            oldest, _ = self._removed.popitem(last=False)
            changes[Table.REMOVED_LINKS, oldest] = None
        return changes

    def _drop_names(self, names: list[str]) -> None:
        self._names.difference_update(names)
        self._by_call.difference_update(names)
        self._announced.difference_update(names)

    def _put(self, changes: Changes) -> int:
        if not changes or self._writer is None:
            return NO_STATE_WRITE
        return self._writer.put(changes)


def _last_links(commit: wire.Commit, *, by_call: bool) -> dict[str, StoredLink]:
    """The link of each child as the tree has it after a static commit: of several rows of one child
    it applies the one with the highest stamp last, and the last of those."""
    links: dict[str, StoredLink] = {}
    names = commit.rows.names
    columns = zip(
        commit.rows.parent.tolist(),
        commit.rows.child.tolist(),
        commit.rows.stamp.tolist(),
        commit.rows.pose.tolist(),
        strict=True,
    )
    for parent, child, stamp_ns, pose in columns:
        before = links.get(names[child])
        if before is None or stamp_ns >= before.stamp_ns:
            links[names[child]] = StoredLink(
                names[parent], stamp_ns, tuple(pose), commit.authority, by_call
            )
    return links
