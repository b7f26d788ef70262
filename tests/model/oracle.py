"""What the tree must answer, said as plainly as possible: lists, searched from the start.

One thread, no locks, nothing shared with the product but its exceptions. The rules are those of
``docs/`` and of ``zenoh_tf/core/history.hpp``; stamps are integer nanoseconds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple, NoReturn

from zenoh_tf import errors

from .poses import IDENTITY, Pose, compose, interpolated, inverse, normalised


class Row(NamedTuple):
    """A write: the pose of child in parent."""

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


class Answer(NamedTuple):
    stamp_ns: int
    newest_stamp_ns: int | None  # "latest" lookups only
    pose: Pose


class Way(NamedTuple):
    """Up from a frame, as far as it goes: ``frames[i + 1]`` is the parent in ``poses[i]``."""

    frames: list[str]
    poses: list[Pose]
    end: errors.TransformException | None  # None: a root


class Oracle:
    def __init__(self, cache_ns: int, max_depth: int = 1000, time_jump: str = "reject") -> None:
        self.cache_ns = cache_ns
        self.max_depth = max_depth
        self.time_jump = time_jump
        self.names: list[str] = []  # in order of creation
        self.removed: set[str] = set()  # of these
        self.links: dict[str, Link] = {}  # by child; a list, once in here, is not changed
        self.counts: dict[str, Counter[str]] = {}  # by child: what its rows did
        self.events: Counter[str] = Counter()  # what has happened at all

    # Writing

    def set_transform(self, row: Row, authority: str = "", static: bool = False) -> bool:
        return self.commit([row], static, drop_old=True)

    def set_transforms_xact(
        self, rows: Sequence[Row], authority: str = "", static: bool = False
    ) -> None:
        self.commit(rows, static, drop_old=False)

    def clear(self, keep_static: bool = True) -> None:
        self.links = {c: link for c, link in self.links.items() if keep_static and link.static}

    def remove_frame(self, name: str, subtree: bool = False) -> None:
        self.known(name)
        children = [c for c, link in self.links.items() if link.samples[-1].parent == name]
        if children and not subtree:
            self._refuse("parent of others")
        for child in children:
            self.remove_frame(child, subtree=True)
        self.removed.add(name)
        self.links.pop(name, None)
        self.events["removed"] += 1

    def commit(self, rows: Sequence[Row], static: bool, drop_old: bool) -> bool:
        rows = [self.checked(row) for row in rows]
        before = self.links
        links, happened = self.with_rows(before, rows, static)
        if self.time_jump == "clear" and any(what == "dropped" for _, what in happened):
            before = {child: link for child, link in before.items() if link.static}
            links, happened = self.with_rows(before, rows, static)
            happened.append((rows[0].child, "time jump"))
        dropped = [child for child, what in happened if what == "dropped"]
        if dropped and not drop_old:
            self._refuse("too old in a transaction")
        if self.has_cycle(links):
            self._refuse("cycle")
        for child in {row.child for row in rows} & before.keys():
            old, new = before[child], links[child]
            if old.static != new.static:
                happened.append((child, "switched"))
            if old.samples[-1].parent != new.samples[-1].parent:
                happened.append((child, "reparented"))
        self.links = links
        for row in rows:
            self.names += [n for n in (row.child, row.parent) if n not in self.names]
            self.events["come back"] += len(self.removed & {row.child, row.parent})
            self.removed -= {row.child, row.parent}
        for child, what in happened:
            self.counts.setdefault(child, Counter())[what] += 1
            self.events[what] += 1
        return not dropped

    @staticmethod
    def has_cycle(links: dict[str, Link]) -> bool:
        """Among the newest parents."""
        for child in links:
            frame, seen = child, set()
            while frame in links:
                seen.add(frame)
                frame = links[frame].samples[-1].parent
                if frame in seen:
                    return True
        return False

    def with_rows(
        self, links: dict[str, Link], rows: Sequence[Row], static: bool
    ) -> tuple[dict[str, Link], list[tuple[str, str]]]:
        """The links with these rows put in, and what happened to whom."""
        links = dict(links)
        happened = []
        for row in sorted(rows, key=lambda row: row.stamp_ns):
            happened += [(row.child, what) for what in self.insert(links, row, static)]
        return links, happened

    def checked(self, row: Row) -> Row:
        """The row as it is stored."""
        parent, child = row.parent.removeprefix("/"), row.child.removeprefix("/")
        if not parent or not child:
            self._refuse("empty name")
        if parent == child:
            self._refuse("own parent")
        if not all(map(math.isfinite, row.pose)):
            self._refuse("not finite")
        if abs(sum(v * v for v in row.pose[3:]) - 1.0) >= 1e-2:
            self._refuse("not a rotation")
        return Row(parent, child, row.stamp_ns, normalised(row.pose))

    def insert(self, links: dict[str, Link], row: Row, static: bool) -> list[str]:
        """Put a row in where it belongs; what happened."""
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

    # Walking; a time of None is the newest of every link

    def at(self, frame: str, stamp_ns: int | None) -> Sample | None:
        """The link above a frame at a time; None for a root."""
        if frame not in self.links:
            return None
        static, samples = self.links[frame]
        if static or stamp_ns is None:
            return samples[-1]
        for sample in samples:
            if sample.stamp_ns == stamp_ns:
                return sample
        oldest, newest = samples[0], samples[-1]
        at_fault = newest
        kind: type[errors.ExtrapolationException] = errors.ForwardExtrapolationException
        if len(samples) == 1:
            kind = errors.NoDataForExtrapolationException
        elif stamp_ns < oldest.stamp_ns:
            kind, at_fault = errors.BackwardExtrapolationException, oldest
        elif stamp_ns < newest.stamp_ns:
            return self._between_samples(samples, stamp_ns)
        raise kind(
            frame=frame,
            parent_frame=at_fault.parent,
            stamp_ns=stamp_ns,
            oldest_stamp_ns=oldest.stamp_ns,
            newest_stamp_ns=newest.stamp_ns,
        )

    def _between_samples(self, samples: list[Sample], stamp_ns: int) -> Sample:
        older = [s for s in samples if s.stamp_ns < stamp_ns][-1]
        newer = next(s for s in samples if s.stamp_ns > stamp_ns)
        if older.parent != newer.parent:
            self.events["older parent stands"] += 1
            return older
        self.events["interpolated"] += 1
        ratio = (stamp_ns - older.stamp_ns) / (newer.stamp_ns - older.stamp_ns)
        return Sample(stamp_ns, older.parent, interpolated(older.pose, newer.pose, ratio))

    def way(self, frame: str, stamp_ns: int | None) -> Way:
        frames: list[str] = [frame]
        poses: list[Pose] = []
        while True:
            try:
                link = self.at(frames[-1], stamp_ns)
            except errors.ExtrapolationException as error:
                return Way(frames, poses, error)
            if link is None:
                return Way(frames, poses, None)
            if len(poses) == self.max_depth:
                self.events["too deep" if len(set(frames)) == len(frames) else "past loop"] += 1
                return Way(frames, poses, errors.LookupException(limit=self.max_depth))
            frames.append(link.parent)
            poses.append(link.pose)

    def ways(self, target: str, source: str, stamp_ns: int | None) -> tuple[Way, Way]:
        """From both frames up to the first where they meet."""
        up, other = self.way(target, stamp_ns), self.way(source, stamp_ns)
        for i, frame in enumerate(up.frames):
            if frame in other.frames:
                j = other.frames.index(frame)
                return (
                    Way(up.frames[: i + 1], up.poses[:i], None),
                    Way(other.frames[: j + 1], other.poses[:j], None),
                )
        ends = [end for end in (up.end, other.end) if end is not None]
        for kind in (errors.LookupException, errors.ExtrapolationException):
            for end in ends:
                if isinstance(end, kind):
                    raise end
        raise errors.ConnectivityException(
            target_root=up.frames[-1], source_root=other.frames[-1], stamp_ns=stamp_ns
        )

    def _join(self, target: str, source: str, stamp_ns: int | None) -> Pose:
        up, other = self.ways(target, source, stamp_ns)
        return compose(inverse(_product(up)), _product(other))

    def _stamps(self, target: str, source: str) -> list[int]:
        """Of the newest of every link between the two, but for static ones."""
        if target == source:
            children = [target] if target in self.links else []
        else:
            up, other = self.ways(target, source, None)
            children = up.frames[:-1] + other.frames[:-1]
        links = [self.links[child] for child in children]
        return [link.samples[-1].stamp_ns for link in links if not link.static]

    # Reading

    def lookup_transform(self, target: str, source: str, stamp_ns: int | None = None) -> Answer:
        self.known(target, source)
        if stamp_ns is None:
            stamp_ns = min(self._stamps(target, source), default=0)
        if target == source:
            return Answer(stamp_ns, None, IDENTITY)
        return Answer(stamp_ns, None, self._join(target, source, stamp_ns))

    def lookup_transform_full(
        self, target: str, target_ns: int | None, source: str, source_ns: int | None, fixed: str
    ) -> Answer:
        self.known(target, source, fixed)
        X_fixed_source = self.lookup_transform(fixed, source, source_ns).pose
        stamp_ns, _, X_target_fixed = self.lookup_transform(target, fixed, target_ns)
        return Answer(stamp_ns, None, compose(X_target_fixed, X_fixed_source))

    def lookup_latest_transform(self, target: str, source: str) -> Answer:
        self.known(target, source)
        stamps = self._stamps(target, source)
        pose = IDENTITY if target == source else self._join(target, source, None)
        return Answer(min(stamps, default=0), max(stamps, default=0), pose)

    lookup_latest_transform_xact = lookup_latest_transform

    def lookup_latest_transforms_xact(self, pairs: Sequence[tuple[str, str]]) -> list[Answer]:
        self.check_names(*(name for pair in pairs for name in pair))
        return [self.lookup_latest_transform(*pair) for pair in pairs]

    def sample(self, target: str, source: str, stamps_ns: Sequence[int]) -> list[Answer | int]:
        """An error's code in place of an answer."""
        self.check_names(target, source)
        answers: list[Answer | int] = []
        for stamp_ns in stamps_ns:
            try:
                answers.append(self.lookup_transform(target, source, stamp_ns))
            except errors.TransformException as error:
                answers.append(error.code)
        return answers

    def can_transform(self, target: str, source: str, stamp_ns: int | None = None) -> bool:
        try:
            self.lookup_transform(target, source, stamp_ns)
        except errors.TransformException:
            return False
        return True

    def latest_common_time(self, a: str, b: str) -> int | None:
        self.known(a, b)
        return min(self._stamps(a, b), default=None)

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        self.known(target, source)
        if target == source:
            return [target]
        up, other = self.ways(target, source, stamp_ns)
        return up.frames + other.frames[-2::-1]

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """None for a root, and where the link has nothing for that time."""
        self.known(frame)
        try:
            link = self.at(frame, stamp_ns)
        except errors.ExtrapolationException:
            return None
        return link.parent if link else None

    def frames(self) -> list[str]:
        return [name for name in self.names if name not in self.removed]

    def stats(self) -> dict[str, int]:
        links = self.links.values()
        return {
            "frames": len(self.frames()),
            "static_links": sum(link.static for link in links),
            "samples": sum(len(link.samples) for link in links if not link.static),
            "time_jumps": self.events["time jump"],
        }

    def frame(self, frame: str) -> dict[str, object]:
        self.known(frame)
        counts = self.counts.get(frame, Counter())
        counted = {k: counts[k] for k in ("rewritten", "dropped", "reparented", "switched")}
        if frame not in self.links:
            return {"parent": None, "static": False, "samples": 0, **counted}
        static, samples = self.links[frame]
        return {
            "parent": samples[-1].parent,
            "static": static,
            "samples": len(samples),
            "oldest_stamp_ns": samples[0].stamp_ns,
            "newest_stamp_ns": samples[-1].stamp_ns,
            **counted,
        }

    def check_names(self, *frames: str) -> None:
        for frame in frames:
            if not frame or frame.startswith("/"):
                raise errors.InvalidArgumentException(frame)

    def known(self, *frames: str) -> None:
        self.check_names(*frames)
        for frame in frames:
            if frame not in self.frames():
                raise errors.LookupException(frame=frame)


def _product(way: Way) -> Pose:
    """The pose of the way's first frame in its last."""
    pose = IDENTITY
    for link in way.poses:
        pose = compose(link, pose)
    return pose
