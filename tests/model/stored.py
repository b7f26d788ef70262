"""What the tree must hold after each write: the oracle's write half."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple, NoReturn

from zenoh_tf import errors

from .poses import Pose, normalised

MAX_TRANSLATION = 1e150


class Row(NamedTuple):
    """A write: the pose of a child in its parent."""

    parent: str
    child: str
    stamp_ns: int
    pose: Pose


class Sample(NamedTuple):
    stamp_ns: int
    parent: str
    pose: Pose


class Link(NamedTuple):
    static: bool
    samples: list[Sample]  # by stamp, never empty; one where static


class Stored:
    def __init__(self, cache_ns: int, max_depth: int = 1000, time_jump: str = "reject") -> None:
        self.cache_ns = cache_ns
        self.max_depth = max_depth
        self.time_jump = time_jump
        self.names: list[str] = []  # in order of creation
        self.removed: set[str] = set()  # of these
        self.links: dict[str, Link] = {}  # by child; lists in it are replaced, never changed
        self.counts: dict[str, Counter[str]] = {}  # by child: counts of what its rows did
        self.events: Counter[str] = Counter()  # which events have occurred, and how often
        #: By child: the late stamp that no good row came after, and how many commits led to it.
        self.late: dict[str, tuple[int, int]] = {}
        self.ever_reparented = False

    # Writes

    def set_transform(self, row: Row, authority: str = "", static: bool = False) -> bool:
        return self.commit([row], static, drop_old=True)

    def set_transforms_xact(
        self, rows: Sequence[Row], authority: str = "", static: bool = False
    ) -> None:
        self.commit(rows, static, drop_old=False)

    def clear(self, keep_static: bool = True) -> None:
        kept = {c: link for c, link in self.links.items() if keep_static and link.static}
        self.forget_late(self.links.keys() - kept.keys())
        self.links = kept

    def reset(self) -> None:
        self.removed.update(self.names)
        self.links = {}
        self.late = {}
        self.counts = {}

    def remove_frame(self, name: str, subtree: bool = False) -> None:
        self.known(name)
        children = [c for c, link in self.links.items() if link.samples[-1].parent == name]
        if children and not subtree:
            self._refuse("parent of others")
        for child in children:
            self.remove_frame(child, subtree=True)
        self.removed.add(name)
        self.links.pop(name, None)
        self.counts.pop(name, None)
        self.forget_late([name])
        self.events["removed"] += 1

    def commit(self, rows: Sequence[Row], static: bool, drop_old: bool) -> bool:
        rows = [self.checked(row) for row in rows]
        restarted = [] if static else self.late_frames(rows, drop_old)
        before = {child: link for child, link in self.links.items() if child not in restarted}
        links, happened = self.with_rows(before, rows, static)
        happened += [(child, "time jump") for child in restarted]
        before = self.links
        dropped = [child for child, what in happened if what == "dropped"]
        if dropped and not drop_old:
            self._refuse("too old in a transaction")
        depths = self.new_depths(links, {row.child for row in rows})
        if None in depths:
            self._refuse("cycle")
        if any(depth is not None and depth > self.max_depth for depth in depths):
            self.events["refused: too deep"] += 1
            raise errors.LimitExceeded("too deep")
        for child in {row.child for row in rows} & before.keys():
            old, new = before[child], links[child]
            if old.static != new.static:
                happened.append((child, "switched"))
            if old.samples[-1].parent != new.samples[-1].parent:
                happened.append((child, "reparented"))
        self.note_parents(rows, static, restarted)
        self.forget_late(child for child, what in happened if what in ("stored", "static"))
        self.links = links
        for row in self.creating(rows, any_dropped=bool(dropped)):
            self.names += [n for n in (row.child, row.parent) if n not in self.names]
            self.events["come back"] += len(self.removed & {row.child, row.parent})
            self.removed -= {row.child, row.parent}
        for child, what in happened:
            self.counts.setdefault(child, Counter())[what] += 1
            self.events[what] += 1
        return not dropped

    def creating(self, rows: Sequence[Row], *, any_dropped: bool) -> Sequence[Row]:
        """Return the rows that create their frames: those that are stored.

        Rows are dropped one at a time: only `set_transform` drops any.
        """
        return [] if any_dropped else rows

    def late_frames(self, rows: Sequence[Row], drop_old: bool) -> list[str]:
        """Return the frames that are cleared, and record the late rows of the others.

        A frame's rows are late if all are older than its newest by more than the cache time. It
        restarts if it had late rows before, a little older, and no others in between. A repeat of
        the last late stamp changes nothing.
        """
        restarted = []
        for child in sorted({row.child for row in rows}, key=self.place_of):
            link = self.links.get(child)
            newest_ns = max(row.stamp_ns for row in rows if row.child == child)
            if link is None or link.static:
                continue
            limit_ns = link.samples[-1].stamp_ns - self.cache_ns
            if newest_ns < limit_ns:
                oldest_ns = min(row.stamp_ns for row in rows if row.child == child)
                late_ns, commits = self.late.get(child, (newest_ns, 1))
                if late_ns < newest_ns and oldest_ns <= late_ns + self.cache_ns:
                    commits += 1
                elif late_ns != newest_ns:
                    commits = 1
                self.late[child] = newest_ns, commits  # stays if the commit is refused
                if commits > 1 and self.time_jump == "clear":
                    restarted.append(child)
                    continue
            if not drop_old and any(r.child == child and r.stamp_ns < limit_ns for r in rows):
                break  # the transaction is refused here
        return restarted

    def place_of(self, name: str) -> int:
        return self.names.index(name) if name in self.names else len(self.names)

    def forget_late(self, children: Iterable[str]) -> None:
        for child in list(children):
            self.late.pop(child, None)

    def note_parents(self, rows: Sequence[Row], static: bool, restarted: list[str]) -> None:
        """Forget all late rows when a frame has samples of two parents for the first time."""
        if self.ever_reparented or static:
            return
        newest = {
            child: link.samples[-1]
            for child, link in self.links.items()
            if not link.static and child not in restarted
        }
        for row in sorted(rows, key=lambda row: row.stamp_ns):
            last = newest.get(row.child)
            if last is not None and row.stamp_ns < last.stamp_ns - self.cache_ns:
                continue
            if last is not None and row.parent != last.parent:
                self.ever_reparented |= last.stamp_ns >= row.stamp_ns - self.cache_ns
            if last is None or row.stamp_ns >= last.stamp_ns:
                newest[row.child] = Sample(row.stamp_ns, row.parent, row.pose)
        if self.ever_reparented:
            self.late = {}

    @staticmethod
    def has_cycle(links: dict[str, Link]) -> bool:
        """True if the newest parents contain a cycle."""
        for child in links:
            frame, seen = child, set()
            while frame in links:
                seen.add(frame)
                frame = links[frame].samples[-1].parent
                if frame in seen:
                    return True
        return False

    def new_depths(self, links: dict[str, Link], children: set[str]) -> list[int | None]:
        """Return how many links are above each child with another parent, or None for a cycle.

        A cycle of more links than `max_depth` counts as too deep. Frames below the children may be
        too deep: their lookups say so.
        """
        depths: list[int | None] = []
        for child in children & links.keys():
            before = self.links.get(child)
            if before and before.samples[-1].parent == links[child].samples[-1].parent:
                continue
            frame, depth = links[child].samples[-1].parent, 1
            while frame in links and frame != child and depth <= self.max_depth:
                frame, depth = links[frame].samples[-1].parent, depth + 1
            depths.append(None if frame == child else depth)
        return depths

    def with_rows(
        self, links: dict[str, Link], rows: Sequence[Row], static: bool
    ) -> tuple[dict[str, Link], list[tuple[str, str]]]:
        """Return the links with these rows inserted, and the events by child."""
        links = dict(links)
        happened = []
        for row in sorted(rows, key=lambda row: row.stamp_ns):
            happened += [(row.child, what) for what in self.insert(links, row, static)]
        return links, happened

    def checked(self, row: Row) -> Row:
        """Return the row as it will be stored: stripped names, normalised rotation."""
        parent, child = row.parent.removeprefix("/"), row.child.removeprefix("/")
        if not parent or not child:
            self._refuse("empty name")
        if parent.startswith("/") or child.startswith("/"):
            self._refuse("two slashes")
        if parent == child:
            self._refuse("own parent")
        if not all(map(math.isfinite, row.pose)):
            self._refuse("not finite")
        if math.hypot(*row.pose[:3]) > MAX_TRANSLATION:
            self._refuse("too far")
        if abs(sum(v * v for v in row.pose[3:]) - 1.0) >= 1e-2:
            self._refuse("not a rotation")
        return Row(parent, child, row.stamp_ns, normalised(row.pose))

    def insert(self, links: dict[str, Link], row: Row, static: bool) -> list[str]:
        """Insert a row in stamp order; return the event."""
        sample = Sample(row.stamp_ns, row.parent, row.pose)
        link = links.get(row.child)
        if static:
            links[row.child] = Link(True, [sample])
            return ["static"]
        samples = [] if link is None or link.static else link.samples
        if samples and row.stamp_ns < samples[-1].stamp_ns - self.cache_ns:
            return ["dropped"]
        others = [s for s in samples if s.stamp_ns != row.stamp_ns]
        everything = sorted([*others, sample], key=lambda s: s.stamp_ns)
        oldest_ns = everything[-1].stamp_ns - self.cache_ns
        kept = [s for s in everything if s.stamp_ns >= oldest_ns]
        links[row.child] = Link(False, kept)
        facts = {
            "rewritten": len(others) < len(samples),
            "out of order": kept[-1] is not sample,
            "pruned": len(kept) < len(everything),
        }
        return ["stored", *(what for what, is_so in facts.items() if is_so)]

    def _refuse(self, why: str) -> NoReturn:
        self.events[f"refused: {why}"] += 1
        raise errors.InvalidArgumentException(why)

    # Names

    def frames(self) -> list[str]:
        return [name for name in self.names if name not in self.removed]

    def check_names(self, *frames: str) -> None:
        for frame in frames:
            if not frame or frame.startswith("/"):
                raise errors.InvalidArgumentException(frame)

    def known(self, *frames: str) -> None:
        self.check_names(*frames)
        for frame in frames:
            if frame not in self.frames():
                raise errors.LookupException(frame=frame)
