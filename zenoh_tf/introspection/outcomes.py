"""What an explanation says of each outcome of a lookup: its reasons, and what to do.

`explain` finds the outcome; the sentences about single links are in `sentences`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Final

from zenoh_tf.introspection import sentences
from zenoh_tf.introspection.explanation import Explanation, LinkReport
from zenoh_tf.introspection.frame_info import FrameInfo
from zenoh_tf.text import quoted
from zenoh_tf.text.similar import did_you_mean, spelling
from zenoh_tf.text.times import CLOCK_RANGE_S, age, seconds


def unknown(found: Explanation, unknown: list[str], names: Collection[str]) -> Explanation:
    """A frame does not exist."""
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


def unconnected(found: Explanation, names: Collection[str]) -> Explanation:
    """The frames have no common root."""
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


def extrapolated(found: Explanation, failing: list[LinkReport], reference: int) -> Explanation:
    """Links have no sample around the time that was asked for."""
    worst = max(failing, key=lambda link: link.off_by_ns or 0)
    farthest_first = sorted(failing, key=lambda link: -(link.off_by_ns or 0))
    reasons = [sentences.outside(link, found) for link in farthest_first]
    # Of these causes one explains the failure, and what else is odd follows from it.
    cause = sentences.wrong_unit(found, failing)
    if cause is None and (worst.off_by_ns or 0) > CLOCK_RANGE_S * 10**9:
        cause = sentences.without_stamps(failing) or sentences.OTHER_CLOCK
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


def was_static(chain: Collection[FrameInfo]) -> set[str]:
    """The frames of a chain whose static link was sent as moving last."""
    changes = {frame.name: frame.last_change for frame in chain}
    return {
        name
        for name, change in changes.items()
        if change is not None and change.kind == "switched" and change.static_before
    }


def without_common_time(
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
        cause = sentences.without_stamps([ending]) or sentences.OTHER_CLOCK
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


def answered(found: Explanation, reference: int) -> Explanation:
    """The lookup succeeds."""
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
