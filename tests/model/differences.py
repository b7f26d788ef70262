"""Every deliberate difference from the real tf2, in one place.

The installed tf2 is ROS 1's (0.7.6). ``AsTf2`` is the oracle with tf2's rule in place of ours, one
override for each decision. An allowed difference is thus one exact answer: tf2 must say what
``AsTf2`` says. An answer that differs must also carry the mark of a decision, on a link of its
path or on the question (``reasons``).
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence

from zenoh_tf import errors

from .calls import Call
from .oracle import AncestorPath, Answer, Link, Oracle, Row, Sample
from .poses import IDENTITY

#: By number in the table of decisions. The first ones withhold a write from tf2, or change it.
DECISIONS = {
    "A08": "tf2 stores a rotation as it comes; it is given the normalised one",
    "A08b": "tf2 stores infinite translations, and those over 1e150 m: not given to it",
    "A09": "tf2 stores a name with two slashes in front under one: not given to it",
    "A10": "tf2 has no transactions: one that is refused here is not given to it; a sample that it "
    "drops creates its frames",
    "F07": "tf2 accepts cycles: what would close one is not given to it; a loop of a past time "
    "above the frames' meeting point fails a lookup in tf2",
    "F06": "before geometry2#832 tf2 names the first link without data, not the farthest",
    "F06b": "of a lookup without a time, tf2 names a link that lacks a sample, not the one that "
    "had ended before that began",
    "B12": "ROS 1's tf2 ignores a repeated stamp; ROS 2's and this tree have other rules",
    "C06": "in ROS 1's tf2 a frame's first write says for ever whether it is static",
    "C07": "tf2 has no data at a time above a cleared frame; here it is a root like others",
    "F04": "of a question that is wrong twice, tf2 names the first fault, this tree the bad name",
    "E08": "in tf2 an unknown frame, or no name at all, is the identity to itself",
}


class AsTf2(Oracle):
    def __init__(self, cache_ns: int, max_depth: int) -> None:
        super().__init__(cache_ns, max_depth)
        self.static: dict[str, bool] = {}  # by child, set at its first write
        self.marks: dict[str, set[str]] = {}  # by child: decisions that affect its history
        self.fired: set[str] = set()  # decisions that affect the last answers

    def closes_cycle(self, rows: Sequence[Row], static: bool) -> bool:
        """True if these rows would close a cycle. Changes nothing."""
        trial = copy.copy(self)
        trial.static, trial.marks = dict(self.static), copy.deepcopy(self.marks)
        return self.has_cycle(trial.with_rows(self.links, rows, static)[0])

    def insert(self, links: dict[str, Link], row: Row, static: bool) -> list[str]:
        as_static = self.static.setdefault(row.child, static)
        if as_static != static:
            self.marks.setdefault(row.child, set()).add("C06")
        link = links.get(row.child)
        if link and not as_static and any(s.stamp_ns == row.stamp_ns for s in link.samples):
            self.marks.setdefault(row.child, set()).add("B12")
            return ["repeated"]
        return super().insert(links, row, as_static)

    def creating(self, rows: Sequence[Row], *, any_dropped: bool) -> Sequence[Row]:
        return rows

    def lookup_transform(self, target: str, source: str, stamp_ns: int | None = None) -> Answer:
        if target == source and target not in self.names:
            self.fired.add("E08")
            return Answer(stamp_ns or 0, None, IDENTITY)
        return super().lookup_transform(target, source, stamp_ns)

    def known(self, *frames: str) -> None:
        faults = []
        for frame in frames:
            try:
                super().known(frame)
            except errors.TransformException as fault:
                faults.append(fault)
        if faults:
            if len({type(fault) for fault in faults}) > 1:
                self.fired.add("F04")
            raise faults[0]

    def paths(
        self, target: str, source: str, stamp_ns: int | None
    ) -> tuple[AncestorPath, AncestorPath]:
        if stamp_ns is None:
            return super().paths(target, source, stamp_ns)
        up, other = self.path(target, stamp_ns), self.path(source, stamp_ns)
        if isinstance(other.end, errors.LookupException) and target not in other.frames:
            self.fired.add("F07")
            raise other.end
        try:
            return super().paths(target, source, stamp_ns)
        except (errors.ConnectivityException, errors.ExtrapolationException):
            # tf2 reports the failure on the target's path first, then on the source's.
            if self._cleared(up) or (up.end is None and self._cleared(other)):
                self.fired.add("C07")
                raise errors.ExtrapolationException from None
            raise

    def _farthest(
        self, target: str, source: str, stamp_ns: int
    ) -> errors.TransformException | None:
        self.fired.add("F06")
        return None

    def _name_ended(self, error: errors.ExtrapolationException, target: str, source: str) -> None:
        self.fired.add("F06b")

    def _cleared(self, path: AncestorPath) -> bool:
        top = path.frames[-1]
        return path.end is None and top in self.static and top not in self.links


def reasons(ours: Oracle, theirs: AsTf2, call: Call) -> set[str]:
    """Return the decisions that can explain a difference: marks on links that do differ."""
    names = [a for a in call.arguments if isinstance(a, str)]
    stamps = {None, *(a for a in call.arguments if isinstance(a, int))}
    stamps |= {s.stamp_ns for oracle in (ours, theirs) for s in _newest(oracle, names)}
    frames = {
        frame
        for oracle in (ours, theirs)
        for name in names
        for stamp_ns in stamps
        for frame in oracle.path(name, stamp_ns).frames
    }
    differing = {f for f in frames if ours.links.get(f) != theirs.links.get(f)}
    # Frames of samples that only this tree dropped (A10).
    ghosts = {name for name in names if name in theirs.names and name not in ours.names}
    fired = theirs.fired | ({"A10"} if ghosts else set())
    return fired.union(*(theirs.marks.get(frame, set()) for frame in differing))


def _newest(oracle: Oracle, names: Iterable[str]) -> list[Sample]:
    frames = {frame for name in names for frame in oracle.path(name, None).frames}
    return [oracle.links[frame].samples[-1] for frame in frames if frame in oracle.links]
