"""Why a lookup succeeds or fails: which link limits it, and what to do.

`explain` works on the records of the frames from both ends up to their roots, which
`TransformTree`, a server and a mirror all give as of one instant.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from operator import index
from typing import Final, Protocol, TypeVar

from zenoh_tf.errors import ServerStarting
from zenoh_tf.introspection import outcomes, sentences
from zenoh_tf.introspection.explanation import Explanation, LinkReport
from zenoh_tf.introspection.frame_info import AuthorityInfo, FrameInfo
from zenoh_tf.text.times import reference_ns

__all__ = [
    "explain",
    "interpolated",
    "is_connected",
    "is_of_mirror",
    "is_stopped",
    "path_to_root",
    "starting",
    "stopped_after_s",
    "unknown_frames",
    "with_gaps",
    "with_lost_mirrors",
]

#: A link has stopped if nothing has come for so many of its periods, and for so long.
_STOPPED_PERIODS: Final = 10
_STOPPED_S: Final = 1.0

Path = list[FrameInfo]


class _HasParent(Protocol):
    @property
    def parent(self) -> str | None: ...


F = TypeVar("F", bound=_HasParent)


def stopped_after_s(frame: FrameInfo) -> float | None:
    """Return for how long no sample of a frame's link may come until it has stopped; None without
    a rate."""
    rate_hz = frame.rate_hz
    return None if rate_hz is None else max(_STOPPED_S, _STOPPED_PERIODS / rate_hz)


def is_stopped(frame: FrameInfo, now_ns: int) -> bool:
    """Return whether the samples of a frame's link have ceased to come, by their stamps."""
    limit_s = stopped_after_s(frame)
    if limit_s is None or frame.newest_stamp_ns is None:
        return False
    return (now_ns - frame.newest_stamp_ns) * 1e-9 > limit_s


def is_connected(target: str, source: str, frames: Collection[FrameInfo]) -> bool:
    """Return whether a chain joins two frames, which are unknown if they have no record. `frames`:
    those from both up to their roots."""
    by_name = {frame.name: frame for frame in frames}
    from_target, from_source = (path_to_root(name, by_name) for name in (target, source))
    return bool(from_target) and bool(from_source) and from_target[-1].name == from_source[-1].name


def explain(
    target: str,
    source: str,
    stamp_ns: int | None,
    frames: Collection[FrameInfo],
    names: Collection[str] = (),
    now_ns: int | None = None,
    *,
    recorded: bool = False,
) -> Explanation:
    """Return why a lookup succeeds or fails.

    Args:
        target: The lookup's target.
        source: The lookup's source.
        stamp_ns: The lookup's time in nanoseconds; None for the latest common time.
        frames: The frames from both up to their roots, with the parents at that time.
        names: The names of all frames, to suggest others; needed if there is no chain.
        now_ns: The time to count ages from, nanoseconds; None means this machine's clock.
        recorded: The frames are of a recording, which has no present and no publishers.
    """
    by_name = {frame.name: frame for frame in frames}
    from_target, from_source = (path_to_root(name, by_name) for name in (target, source))
    clock_ns = time.time_ns() if now_ns is None else now_ns
    stamps = [f.newest_stamp_ns for f in frames if not f.static and f.newest_stamp_ns is not None]
    reference, by_clock = (
        (max(stamps, default=0), False) if recorded else reference_ns(stamps, clock_ns)
    )
    base = Explanation(
        target=target,
        source=source,
        stamp_ns=None if stamp_ns is None else index(stamp_ns),
        target_root=from_target[-1].name if from_target else None,
        source_root=from_source[-1].name if from_source else None,
        by_clock=by_clock,
    )
    unknown = [name for name in dict.fromkeys((target, source)) if name not in by_name]
    if unknown:
        return outcomes.unknown(base, unknown, names)
    if from_target[-1].name != from_source[-1].name:
        moves = sentences.moves([*from_target, *from_source], reference, by_clock, recent=False)
        return _with_reasons(outcomes.unconnected(base, names), moves)
    chain = _chain(from_target, from_source)
    return _explain_chain(base, chain, reference, recorded=recorded)


def unknown_frames(found: Explanation) -> list[str]:
    """The names of a lookup that the tree did not have."""
    roots = {found.target: found.target_root, found.source: found.source_root}
    return [name for name, root in roots.items() if root is None]


def starting(found: Explanation, error: ServerStarting) -> Explanation:
    """Return why a lookup fails that failed because of an unknown frame, whose server said so."""
    first, _, advice = str(error).partition(": ")
    reasons = found.reasons if found.error == type(error).__name__ else ()
    return replace(
        found,
        error=type(error).__name__,
        reasons=(*reasons, f"{first[:1].upper()}{first[1:]}."),
        advice=(f"{advice[:1].upper()}{advice[1:]}.",),
    )


def with_lost_mirrors(found: Explanation, authorities: Iterable[AuthorityInfo]) -> Explanation:
    """Add which links are the last ones that came of a robot that is disconnected."""
    used = {link.authority for link in found.links}
    lost = [each for each in authorities if each.mirror_lost_s is not None and each.name in used]
    reasons = [f"{sentences.mirror_is_lost(each)}, and its last poses are served." for each in lost]
    advice = "Check that its server runs, and the network to it."
    return replace(
        found,
        reasons=(*found.reasons, *dict.fromkeys(f"{x[:1].upper()}{x[1:]}" for x in reasons)),
        advice=(*found.advice, advice) if reasons else found.advice,
    )


def is_of_mirror(found: Explanation) -> bool:
    """Whether the server may have a link from a robot that it mirrors."""
    return any(":" in link.authority for link in found.links)


def interpolated(found: Explanation) -> tuple[list[str], list[str]]:
    """Return the parents and the children of the links that may be in a gap; see `with_gaps`."""
    links = [link for link in found.links if found.possible and not link.static]
    return [link.parent for link in links], [link.child for link in links]


def with_gaps(found: Explanation, gaps_ns: Sequence[int]) -> Explanation:
    """Return an explanation with the gap of each of its `interpolated` links at its time."""
    gaps = dict(zip(interpolated(found)[1], gaps_ns, strict=True))
    links = tuple(replace(link, gap_ns=gaps.get(link.child, 0)) for link in found.links)
    over = [link for link in links if link.gap_ns]
    reasons = [*found.reasons, *(sentences.gap(link) for link in over)]
    return replace(found, links=links, reasons=tuple(reasons))


def _explain_chain(
    base: Explanation, chain: Path, reference: int, *, recorded: bool
) -> Explanation:
    dynamic = [frame for frame in chain if not frame.static]
    newest = [frame.newest_stamp_ns for frame in dynamic if frame.newest_stamp_ns is not None]
    common_ns = min(newest, default=None)
    at_ns = common_ns if base.stamp_ns is None else base.stamp_ns
    found = replace(
        base,
        at_ns=at_ns,
        links=tuple(_link(frame, at_ns, reference) for frame in chain),
    )
    failing = [link for link in found.links if link.problem is not None]
    moves = sentences.moves(chain, reference, base.by_clock, recent=True)
    if failing:
        if found.stamp_ns is None:
            failed = outcomes.without_common_time(
                found, failing, reference, outcomes.was_static(chain)
            )
        else:
            failed = outcomes.extrapolated(found, failing, reference)
        if recorded:
            failed = replace(failed, advice=(sentences.recorded_range(found, failing),))
        return _with_reasons(failed, moves)
    first = min(dynamic, key=lambda frame: frame.newest_stamp_ns or 0, default=None)
    found = replace(found, possible=True, limiting_frame=None if first is None else first.name)
    answered = outcomes.answered(found, reference)
    return _with_reasons(replace(answered, advice=()) if recorded else answered, moves)


def _with_reasons(found: Explanation, reasons: list[str]) -> Explanation:
    return replace(found, reasons=(*found.reasons, *reasons))


def _names(frames: Iterable[FrameInfo]) -> set[str]:
    return {frame.name for frame in frames}


def path_to_root(name: str, frames: Mapping[str, F]) -> list[F]:
    """Return the frames from this one up to its root; none if it is unknown. Records of past or of
    several moments may form a loop: each is there once."""
    path: dict[str, F] = {}
    following: str | None = name
    while following is not None and following in frames and following not in path:
        path[following] = frames[following]
        following = path[following].parent
    return [*path.values()]


def _chain(from_target: Path, from_source: Path) -> Path:
    """The child frames of the links from target to source."""
    above_source = _names(from_source)
    down = [frame for frame in from_target if frame.name not in above_source]
    above_target = _names(from_target)
    up = [frame for frame in from_source if frame.name not in above_target]
    return [*down, *reversed(up)]


def _link(frame: FrameInfo, at_ns: int | None, reference: int) -> LinkReport:
    oldest, newest = frame.oldest_stamp_ns, frame.newest_stamp_ns
    report = LinkReport(
        child=frame.name,
        parent=frame.parent or "",
        authority=frame.authority,
        static=frame.static,
        samples=frame.samples,
        rate_hz=frame.rate_hz,
    )
    if frame.static or oldest is None or newest is None:
        return report
    report = replace(
        report,
        oldest_stamp_ns=oldest,
        newest_stamp_ns=newest,
        age_s=(reference - newest) / 1e9,
        stopped=is_stopped(frame, reference),
    )
    if at_ns is None or oldest <= at_ns <= newest:
        return report
    off_by_ns = at_ns - newest if at_ns > newest else oldest - at_ns
    if frame.samples == 1:
        return replace(report, problem="single_sample", off_by_ns=off_by_ns)
    return replace(report, problem="too_new" if at_ns > newest else "too_old", off_by_ns=off_by_ns)
