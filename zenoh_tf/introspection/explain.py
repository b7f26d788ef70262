"""Why a lookup succeeds or fails: which link limits it, and what to do.

`explain` works on the records of the frames from both ends up to their roots, which
`TransformTree`, a server and a mirror all give as of one instant.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Final

from zenoh_tf.introspection.explanation import Explanation, LinkReport
from zenoh_tf.introspection.frame_info import FrameInfo
from zenoh_tf.text import quoted
from zenoh_tf.text.similar import did_you_mean
from zenoh_tf.text.times import CLOCK_RANGE_S, age, reference_ns, seconds

__all__ = ["explain", "is_connected", "is_stopped"]

#: A link has stopped if nothing has come for so many of its periods, and for so long.
_STOPPED_PERIODS: Final = 10
_STOPPED_S: Final = 1.0
#: A time so far ahead of the clock is of another clock; less is the delay of messages.
_AHEAD_NS: Final = 100_000_000

Path = list[FrameInfo]


def is_stopped(frame: FrameInfo, now_ns: int) -> bool:
    """Return whether a link's samples have ceased to come.

    Args:
        frame: The link's child.
        now_ns: The time to compare with, nanoseconds.
    """
    if frame.static or frame.newest_stamp_ns is None or frame.rate_hz is None:
        return False
    expected_s = max(_STOPPED_S, _STOPPED_PERIODS / frame.rate_hz)
    return (now_ns - frame.newest_stamp_ns) * 1e-9 > expected_s


def is_connected(target: str, source: str, frames: Collection[FrameInfo]) -> bool:
    """Return whether a chain joins two frames, which are unknown if they have no record.

    Args:
        target: One frame.
        source: The other frame.
        frames: The frames from both up to their roots.
    """
    from_target, from_source = _path(target, frames), _path(source, frames)
    return bool(from_target) and bool(from_source) and from_target[-1].name == from_source[-1].name


def explain(
    target: str,
    source: str,
    stamp_ns: int | None,
    frames: Collection[FrameInfo],
    names: Collection[str] = (),
    now_ns: int | None = None,
) -> Explanation:
    """Return why a lookup succeeds or fails.

    Args:
        target: The lookup's target.
        source: The lookup's source.
        stamp_ns: The lookup's time in nanoseconds; None for the latest common time.
        frames: The frames from both up to their roots, with the parents at that time.
        names: The names of all frames, to suggest others; needed if there is no chain.
        now_ns: The time to count ages from, nanoseconds; None means this machine's clock.
    """
    from_target, from_source = _path(target, frames), _path(source, frames)
    clock_ns = time.time_ns() if now_ns is None else now_ns
    stamps = [f.newest_stamp_ns for f in frames if not f.static and f.newest_stamp_ns is not None]
    reference, by_clock = reference_ns(stamps, clock_ns)
    base = Explanation(
        target=target,
        source=source,
        stamp_ns=stamp_ns,
        at_ns=None,
        possible=False,
        error=None,
        links=(),
        limiting_frame=None,
        target_root=from_target[-1].name if from_target else None,
        source_root=from_source[-1].name if from_source else None,
        by_clock=by_clock,
        reasons=(),
        advice=(),
    )
    unknown = [name for name in dict.fromkeys((target, source)) if name not in _names(frames)]
    if unknown:
        return _unknown(base, unknown, names)
    if from_target[-1].name != from_source[-1].name:
        return _unconnected(base, names)
    chain = _chain(from_target, from_source)
    dynamic = [frame for frame in chain if not frame.static]
    newest = [frame.newest_stamp_ns for frame in dynamic if frame.newest_stamp_ns is not None]
    common_ns = min(newest, default=None)
    at_ns = common_ns if stamp_ns is None else stamp_ns
    found = replace(
        base,
        at_ns=at_ns,
        links=tuple(_link(frame, at_ns, reference) for frame in chain),
    )
    failing = [link for link in found.links if link.problem is not None]
    if failing:
        return _extrapolated(found, failing, reference)
    first = min(dynamic, key=lambda frame: frame.newest_stamp_ns or 0, default=None)
    found = replace(found, possible=True, limiting_frame=None if first is None else first.name)
    return _answered(found, reference)


def _names(frames: Iterable[FrameInfo]) -> set[str]:
    return {frame.name for frame in frames}


def _path(name: str, frames: Iterable[FrameInfo]) -> Path:
    """The frames from this one up to its root."""
    by_name = {frame.name: frame for frame in frames}
    path: Path = []
    following = by_name.pop(name, None)  # each once, as past links may form a loop
    while following is not None:
        path.append(following)
        following = None if following.parent is None else by_name.pop(following.parent, None)
    return path


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
        oldest_stamp_ns=None,
        newest_stamp_ns=None,
        age_s=None,
        stopped=False,
        problem=None,
        off_by_ns=None,
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
        question = did_you_mean(root, [name for name in names if name not in roots])
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


_OTHER_CLOCK: Final = (
    "The time asked for and the stamps of the chain are of different clocks, such as this "
    "machine's and a simulation's: use the clock of the transforms "
    "(use_sim_time in ROS)."
)
_ERRORS: Final = {
    "too_new": "ForwardExtrapolationException",
    "too_old": "BackwardExtrapolationException",
    "single_sample": "NoDataForExtrapolationException",
}


def _extrapolated(found: Explanation, failing: list[LinkReport], reference: int) -> Explanation:
    worst = max(failing, key=lambda link: link.off_by_ns or 0)
    reasons, advice = [], []
    if found.stamp_ns is None and found.at_ns is not None:
        ending = min(
            (link for link in found.links if link.newest_stamp_ns is not None),
            key=lambda link: link.newest_stamp_ns or 0,
        )
        reasons.append(
            f"The latest common time is {seconds(found.at_ns)} s, where {_name(ending)} ends."
        )
    for link in sorted(failing, key=lambda link: -(link.off_by_ns or 0)):
        reasons.append(_outside(link, found))
        if link.problem == "single_sample":
            advice.append(
                f"If {quoted(link.child)} never moves in {quoted(link.parent)}, publish the link "
                f"as static. Else check that {_publisher(link)} still sends."
            )
    too_old = [link for link in failing if link.problem == "too_old"]
    if (worst.off_by_ns or 0) > CLOCK_RANGE_S * 10**9:
        advice = [_OTHER_CLOCK]
    elif too_old:
        advice.append(_too_late(max(too_old, key=lambda link: link.off_by_ns or 0)))
    if _OTHER_CLOCK not in advice and any(
        link.problem == "too_new" and not link.stopped for link in failing
    ):
        advice.append(_too_early(found, reference))
    stopped = [link for link in found.links if link.stopped]
    reasons += [_stopped(link, found.by_clock) for link in stopped]
    advice += [_restart(link) for link in stopped]
    if found.stamp_ns is not None and {"too_new", "too_old"} <= {link.problem for link in failing}:
        reasons.append("No time around it suits all links.")
    return replace(
        found,
        error=_ERRORS[worst.problem or "too_new"],
        limiting_frame=worst.child,
        reasons=tuple(reasons),
        advice=tuple(dict.fromkeys(advice)),
    )


def _outside(link: LinkReport, found: Explanation) -> str:
    off_by = age(link.off_by_ns or 0)
    when = f"{seconds(found.at_ns or 0)} s"
    if link.problem == "single_sample":
        return (
            f"{_name(link)} has a single sample, and {when} is {off_by} off it: there is nothing "
            "to interpolate between."
        )
    if link.problem == "too_new":
        return f"{when} is {off_by} after the newest sample of {_name(link)}."
    return f"{when} is {off_by} before the oldest sample of {_name(link)}."


def _too_late(link: LinkReport) -> str:
    """What to do about a time that a link has no longer, or has never had."""
    reach = (link.newest_stamp_ns or 0) - (link.oldest_stamp_ns or 0)
    return (
        f"{_name(link)} has a history of {age(reach)}. Ask for a later time, sooner, or keep more "
        "(--cache-time, --limit samples_per_frame of the server)."
    )


def _too_early(found: Explanation, reference: int) -> str:
    """What to do about a time that some links have not reached yet."""
    ahead_ns = (found.at_ns or 0) - reference
    if found.by_clock and ahead_ns > _AHEAD_NS:
        return (
            f"The time asked for is {age(ahead_ns)} ahead of this machine's clock: check the clock "
            "that it is from (zenoh-tf clients, zenoh-tf authorities)."
        )
    return (
        "Samples arrive with a delay. Give the lookup a time-out and it waits for the next ones, "
        "or leave out the time to get the latest common one."
    )


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
            f"{_name(ending)} limits the latest common time: all others reach "
            f"{age(further_ns)} further, or more."
        )
    for link in dynamic:
        if link.stopped:
            reasons.append(_stopped(link, found.by_clock))
            advice.append(_restart(link))
        elif link.samples == 1:
            reasons.append(f"{_name(link)} has a single sample: lookups at other times fail.")
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


def _stopped(link: LinkReport, by_clock: bool) -> str:
    since = age(int((link.age_s or 0) * 1e9))
    behind = "old" if by_clock else "behind the newest of the chain"
    return (
        f"{_name(link)} has stopped: its newest sample is {since} {behind}, "
        f"and before that they came at {link.rate_hz or 0:.1f} Hz."
    )


def _restart(link: LinkReport) -> str:
    return (
        f"Check that {_publisher(link)} runs and reaches the server: zenoh-tf authorities counts "
        "what it has sent, and names the reason if the server refused it."
    )


def _name(link: LinkReport) -> str:
    return f"{quoted(link.parent)} -> {quoted(link.child)}"


def _publisher(link: LinkReport) -> str:
    return quoted(link.authority) if link.authority else "its publisher, which gave no name,"
