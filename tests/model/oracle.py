"""What the tree must answer, in the simplest possible code: lists, searched linearly.

It has one thread and no locks, and shares only the exceptions with the product. The rules are those
of ``docs/`` and ``zenoh_tf/core/histories/insert.hpp``. Stamps are integer nanoseconds.
``stored.py`` has the writes, this file the reads.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from zenoh_tf import errors

from .poses import IDENTITY, Pose, compose, interpolated, inverse
from .stored import Link, Row, Sample, Stored

__all__ = ["AncestorPath", "Answer", "Link", "Oracle", "Row", "Sample"]


class Answer(NamedTuple):
    stamp_ns: int
    newest_stamp_ns: int | None  # "latest" lookups only
    pose: Pose


class AncestorPath(NamedTuple):
    """The path from a frame to its root. ``poses[i]`` is frame i in its parent, frame i + 1."""

    frames: list[str]
    poses: list[Pose]
    end: errors.TransformException | None  # why the path ends; None: at a root


class Oracle(Stored):
    # Walks. A stamp of None selects the newest sample of every link.

    def at(self, frame: str, stamp_ns: int | None) -> Sample | None:
        """Return the link of a frame to its parent at a time; None for a root."""
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

    def path(self, frame: str, stamp_ns: int | None) -> AncestorPath:
        frames: list[str] = [frame]
        poses: list[Pose] = []
        while True:
            try:
                link = self.at(frames[-1], stamp_ns)
            except errors.ExtrapolationException as error:
                return AncestorPath(frames, poses, error)
            if link is None:
                return AncestorPath(frames, poses, None)
            if len(poses) == self.max_depth:
                self.events["too deep" if len(set(frames)) == len(frames) else "past loop"] += 1
                return AncestorPath(frames, poses, errors.LookupException(limit=self.max_depth))
            frames.append(link.parent)
            poses.append(link.pose)

    def paths(
        self, target: str, source: str, stamp_ns: int | None
    ) -> tuple[AncestorPath, AncestorPath]:
        """Return the paths from both frames to their lowest common ancestor."""
        up, other = self.path(target, stamp_ns), self.path(source, stamp_ns)
        for i, frame in enumerate(up.frames):
            if frame in other.frames:
                j = other.frames.index(frame)
                return (
                    AncestorPath(up.frames[: i + 1], up.poses[:i], None),
                    AncestorPath(other.frames[: j + 1], other.poses[:j], None),
                )
        ends = [end for end in (up.end, other.end) if end is not None]
        for end in ends:
            if isinstance(end, errors.LookupException):
                raise end
        if ends:
            assert stamp_ns is not None
            raise self._farthest(target, source, stamp_ns) or ends[0]
        raise errors.ConnectivityException(
            target_root=up.frames[-1], source_root=other.frames[-1], stamp_ns=stamp_ns
        )

    def _farthest(
        self, target: str, source: str, stamp_ns: int
    ) -> errors.TransformException | None:
        """Return the error of the link between the frames whose samples are farthest from the
        time; None if links do not connect them then, also where these have no sample."""
        up, other = (self._around(frame, stamp_ns) for frame in (target, source))
        ancestor = next((frame for frame in up if frame in other), None)
        if ancestor is None:
            return None
        farthest, found = 0, None
        for child in up[: up.index(ancestor)] + other[: other.index(ancestor)]:
            try:
                self.at(child, stamp_ns)
            except errors.ExtrapolationException as error:
                samples = self.links[child].samples
                distance = max(samples[0].stamp_ns - stamp_ns, stamp_ns - samples[-1].stamp_ns)
                if distance > farthest:
                    farthest, found = distance, error
        return found

    def _around(self, frame: str, stamp_ns: int) -> list[str]:
        """Return the frames from a frame up, by links at a time, or where these have no sample then
        by the nearest one's."""
        frames = [frame]
        while len(frames) <= self.max_depth:
            try:
                link = self.at(frames[-1], stamp_ns)
            except errors.ExtrapolationException as error:
                assert error.parent_frame is not None
                frames.append(error.parent_frame)
                continue
            if link is None:
                break
            frames.append(link.parent)
        return frames

    def _join(self, target: str, source: str, stamp_ns: int | None) -> Pose:
        up, other = self.paths(target, source, stamp_ns)
        return compose(inverse(_product(up)), _product(other))

    def _stamps(self, target: str, source: str) -> list[int]:
        """Return the newest stamp of every dynamic link between the two frames."""
        if target == source:
            children = [target] if target in self.links else []
        else:
            up, other = self.paths(target, source, None)
            children = up.frames[:-1] + other.frames[:-1]
        links = [self.links[child] for child in children]
        return [link.samples[-1].stamp_ns for link in links if not link.static]

    # Reads

    def lookup_transform(self, target: str, source: str, stamp_ns: int | None = None) -> Answer:
        self.known(target, source)
        if stamp_ns is None:
            stamp_ns = min(self._stamps(target, source), default=0)
            try:
                return self.lookup_transform(target, source, stamp_ns)
            except (
                errors.BackwardExtrapolationException,
                errors.NoDataForExtrapolationException,
            ) as error:
                self._name_ended(error, target, source)
                raise
        if target == source:
            return Answer(stamp_ns, None, IDENTITY)
        return Answer(stamp_ns, None, self._join(target, source, stamp_ns))

    def _name_ended(self, error: errors.ExtrapolationException, target: str, source: str) -> None:
        """Of a lookup without a time, make an error name the link that ended first, if that was
        before the link begins that lacks a sample."""
        up, other = self.paths(target, source, None)
        children = [*up.frames[:-1], *reversed(other.frames[:-1])]
        links = {child: self.links[child] for child in children if not self.links[child].static}
        child, ended = min(links.items(), key=lambda item: item[1].samples[-1].stamp_ns)
        newest = ended.samples[-1]
        assert error.oldest_stamp_ns is not None
        if newest.stamp_ns < error.oldest_stamp_ns:
            error.frame, error.parent_frame = child, newest.parent
            error.oldest_stamp_ns = ended.samples[0].stamp_ns
            error.newest_stamp_ns = newest.stamp_ns

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
        """Return one answer per stamp, with an error code in place of a failed one."""
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
        up, other = self.paths(target, source, stamp_ns)
        return up.frames + other.frames[-2::-1]

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """Return the parent; None for a root, or if the link has no sample at that time."""
        self.known(frame)
        try:
            link = self.at(frame, stamp_ns)
        except errors.ExtrapolationException:
            return None
        return link.parent if link else None

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


def _product(path: AncestorPath) -> Pose:
    """Return the pose of the first frame of the path in its last."""
    pose = IDENTITY
    for link in path.poses:
        pose = compose(link, pose)
    return pose
