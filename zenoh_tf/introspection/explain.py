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
from zenoh_tf.introspection import sentences
from zenoh_tf.introspection.explanation import Explanation, LinkReport
from zenoh_tf.introspection.frame_info import AuthorityInfo, FrameInfo
from zenoh_tf.text import quoted
from zenoh_tf.text.similar import did_you_mean, spelling
from zenoh_tf.text.times import CLOCK_RANGE_S, age, reference_ns, seconds

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
        return _unknown(base, unknown, names)
    if from_target[-1].name != from_source[-1].name:
        moves = sentences.moves([*from_target, *from_source], reference, by_clock, recent=False)
        return _with_reasons(_unconnected(base, names), moves)
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
            failed = _without_common_time(found, failing, reference, _was_static(chain))
        else:
            failed = _extrapolated(found, failing, reference)
        if recorded:
            failed = replace(failed, advice=(sentences.recorded_range(found, failing),))
        return _with_reasons(failed, moves)
    first = min(dynamic, key=lambda frame: frame.newest_stamp_ns or 0, default=None)
    found = replace(found, possible=True, limiting_frame=None if first is None else first.name)
    answered = _answered(found, reference)
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


def _unknown(found: Explanation, unknown: list[str], names: Collection[str]) -> Explanation:
    reasons = [f"Frame {quoted(name)} does not exist." for name in unknown]
    advice = []
    for name in unknown:
        question = did_you_mean(name, names)
        if question is not None:
            advice.append(f"{question[0].upper()}{question[1:]}")
    if not names:
        reasons.append("The tree has no frames: nothing has been published to it.")
        advice.append("Check that the sensors publish to this tree, and to this server.")
    elif not advice:
        advice.append(
            f"None of the tree's {len(names):,} frames has a name like it. Check the name, and "
            "that its publisher runs: a frame exists once something is published about it."
        )
    return replace(
        found, error="LookupException", reasons=tuple(reasons), advice=tuple(dict.fromkeys(advice))
    )


def _unconnected(found: Explanation, names: Collection[str]) -> Explanation:
    roots = [root for root in (found.target_root, found.source_root) if root is not None]
    reason = (
        f"{quoted(found.target)} and {quoted(found.source)} are not connected: their roots are "
        f"{quoted(roots[0])} and {quoted(roots[1])}."
    )
    advice = []
    for root in roots:
        # Only another spelling is a likely mistake: both roots have frames below them.
        twins = [name for name in names if name not in roots and spelling(name) == spelling(root)]
        question = did_you_mean(root, twins)
        if question is not None:
            advice.append(
                f"Nothing says where {quoted(root)} is. It may be one of two spellings of one "
                f"name: {question}"
            )
    advice.append(
        f"Publish the link that joins them, such as the pose of {quoted(roots[1])} in a frame of "
        f"the tree of {quoted(roots[0])}, and check that its publisher runs."
    )
    return replace(found, error="ConnectivityException", reasons=(reason,), advice=tuple(advice))


_ERRORS: Final = {
    "too_new": "ForwardExtrapolationException",
    "too_old": "BackwardExtrapolationException",
    "single_sample": "NoDataForExtrapolationException",
}


def _extrapolated(found: Explanation, failing: list[LinkReport], reference: int) -> Explanation:
    worst = max(failing, key=lambda link: link.off_by_ns or 0)
    farthest_first = sorted(failing, key=lambda link: -(link.off_by_ns or 0))
    reasons = [sentences.outside(link, found) for link in farthest_first]
    # Of these causes one explains the failure, and what else is odd follows from it.
    cause = sentences.wrong_unit(found, failing)
    if cause is None and (worst.off_by_ns or 0) > CLOCK_RANGE_S * 10**9:
        cause = sentences.OTHER_CLOCK
    if cause is None:
        cause = sentences.not_come(found, failing, reference)
    advice = [cause]
    if cause is None:
        advice = [*map(_advice, farthest_first)]
        stopped = [link for link in found.links if link.stopped]
        ahead = [link for link in found.links if sentences.is_ahead(link, found)]
        reasons += [sentences.stopped(link, found.by_clock) for link in stopped]
        reasons += [sentences.ahead(link, found) for link in ahead]
        too_old = [link for link in farthest_first if link.problem == "too_old"]
        wrong = [link for link in ahead if not sentences.is_ahead_on_purpose(link, found)]
        advice += [sentences.wrong_clock(link) for link in wrong]
        unsure = [link for link in ahead if link not in wrong]
        if too_old and not any(link in wrong for link in too_old):
            advice.append(sentences.too_late(too_old[0]))
        if any(link.problem == "too_new" and not link.stopped for link in failing):
            advice.append(sentences.TOO_EARLY)
        advice += [sentences.restart(link) for link in stopped]
        advice += [sentences.no_localisation(link) for link in unsure]
    if found.stamp_ns is not None and {"too_new", "too_old"} <= {link.problem for link in failing}:
        reasons.append("No time around it suits all links.")
    return replace(
        found,
        error=_ERRORS[worst.problem or "too_new"],
        limiting_frame=worst.child,
        reasons=tuple(reasons),
        advice=tuple(dict.fromkeys(filter(None, advice))),
    )


def _was_static(chain: Path) -> set[str]:
    """The frames of a chain whose static link was sent as moving last."""
    changes = {frame.name: frame.last_change for frame in chain}
    return {
        name
        for name, change in changes.items()
        if change is not None and change.kind == "switched" and change.static_before
    }


def _without_common_time(
    found: Explanation, failing: list[LinkReport], reference: int, was_static: set[str]
) -> Explanation:
    """Why a lookup without a time fails: a link ends before others begin. It is the one that ends
    that is at fault, unless the stamps of the others are ahead of the clock."""
    ending = min(
        (link for link in found.links if link.newest_stamp_ns is not None),
        key=lambda link: link.newest_stamp_ns or 0,
    )
    assert ending.newest_stamp_ns is not None
    first = max(failing, key=lambda link: link.off_by_ns or 0)
    ahead = [link for link in failing if sentences.is_ahead(link, found)]
    reasons = [
        f"The latest common time is {seconds(ending.newest_stamp_ns)} s, where "
        f"{sentences.name(ending)} ends.",
        f"{sentences.name(first)} begins {age(first.off_by_ns or 0)} later.",
    ]
    if ending.child in was_static:
        reasons.append(sentences.was_static(ending))
    cause = sentences.wrong_unit_of(ending, first)
    if cause is None and (first.off_by_ns or 0) > CLOCK_RANGE_S * 10**9:
        cause = sentences.OTHER_CLOCK
    if cause is not None:
        advice = [cause]
    elif ahead:
        reasons += [sentences.ahead(link, found) for link in ahead]
        wrong = [link for link in ahead if not sentences.is_ahead_on_purpose(link, found)]
        advice = [sentences.wrong_clock(link) for link in wrong]
        advice += [sentences.no_localisation(link) for link in ahead if link not in wrong]
    elif ending.samples == 1 or ending.child in was_static:
        advice = [sentences.publish_static(ending)]
    else:
        reasons.append(sentences.stopped(ending, found.by_clock))
        advice = [sentences.restart(ending)]
    links = tuple(
        replace(link, stopped=True) if link is ending else replace(link, problem=None)
        for link in found.links
    )
    return replace(
        found,
        error=_ERRORS[first.problem or "too_old"],
        limiting_frame=ending.child,
        links=found.links if ahead else links,
        reasons=tuple(reasons),
        advice=tuple(dict.fromkeys(advice)),
    )


def _advice(link: LinkReport) -> str | None:
    """What to do about a link with a single sample."""
    if link.problem != "single_sample":
        return None
    return sentences.publish_static(link)


def _answered(found: Explanation, reference: int) -> Explanation:
    dynamic = [link for link in found.links if link.newest_stamp_ns is not None]
    if not dynamic:
        what = "All links are static" if found.links else "A frame in itself does not move"
        reason = f"The lookup succeeds. {what}, so it does for every time."
        return replace(found, reasons=(reason,))
    assert found.at_ns is not None
    reasons = [f"The lookup succeeds at {seconds(found.at_ns)} s{_ago(found, reference)}."]
    advice = []
    ending = next(link for link in dynamic if link.child == found.limiting_frame)
    others = [link.newest_stamp_ns or 0 for link in dynamic if link is not ending]
    further_ns = min(others, default=0) - (ending.newest_stamp_ns or 0)
    limits = found.stamp_ns is None and bool(others) and further_ns > 0
    if limits:
        reasons.append(
            f"{sentences.name(ending)} limits the latest common time: all others reach "
            f"{age(further_ns)} further, or more."
        )
    for link in dynamic:
        if link.stopped:
            reasons.append(sentences.stopped(link, found.by_clock))
            advice.append(sentences.restart(link))
        elif sentences.is_ahead(link, found):
            reasons.append(sentences.ahead(link, found))
        elif link.samples == 1:
            reasons.append(
                f"{sentences.name(link)} has a single sample: lookups at other times fail."
            )
    if limits:
        advice.append(
            "For the newest sample of each link instead, use the latest lookup (zenoh-tf latest)."
        )
    return replace(found, reasons=tuple(reasons), advice=tuple(dict.fromkeys(advice)))


def _ago(found: Explanation, reference: int) -> str:
    if not found.by_clock or found.at_ns is None:
        return ""
    ago_ns = reference - found.at_ns
    return f", {age(ago_ns)} ago" if ago_ns >= 0 else f", {age(-ago_ns)} ahead of the clock"
