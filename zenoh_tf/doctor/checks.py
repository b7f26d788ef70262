"""The checks of the doctor: each finds one fault in the facts about a tree.

A check yields the subject, a frame or an authority, and the evidence as a sentence.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import Final

from zenoh_tf.doctor.facts import LinkFacts, TreeFacts
from zenoh_tf.introspection.explain import is_stopped
from zenoh_tf.text import quoted
from zenoh_tf.text.similar import spelling
from zenoh_tf.text.times import CLOCK_RANGE_S, age

Evidence = Iterator[tuple[str, str]]

#: A link that changes its parent is grasped or released; more often than this, two publishers
#: disagree.
_FLIPS: Final = 3
_FLIPS_PER_S: Final = 0.2
#: A gap in a link's samples, in its periods and in seconds.
_GAP_PERIODS: Final = 10
_GAP_S: Final = 0.5
#: A clock is wrong if stamps lead by more; being late by less may be the delay of messages.
_AHEAD_S: Final = 0.1
_BEHIND_S: Final = 1.0
#: Repeated stamps: so many while it was observed, or this part of the samples.
_REPEATED: Final = 3
_REPEATED_PART: Final = 0.01
_DEEP: Final = 100
_NORM_ERROR: Final = 1e-3
_SHOWN: Final = 5


def two_publishers(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        frame = link.frame
        if frame.authority_changes >= 2:
            others = [
                authority.name
                for authority in facts.authorities
                if authority.conflicts and authority.name != frame.authority
            ]
            suspects = f"; others that have taken over frames: {_listed(others)}" if others else ""
            yield (
                frame.name,
                f"the link has changed hands {_times(frame.authority_changes)}"
                f"{_lately(facts, link, 'authority_changes')}, the last time to "
                f"{_authority(frame.authority)}{suspects}",
            )


def flip_flop(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        flips = facts.grown(link, "reparented") or 0
        if flips >= _FLIPS and flips >= _FLIPS_PER_S * facts.observed_s:
            change = link.frame.last_change
            before = change.parent_before if change is not None else None
            between = "" if before is None else f", such as from {quoted(before)}"
            yield (
                link.frame.name,
                f"its parent has changed {_times(flips)} in {facts.observed_s:.1f} s{between} to "
                f"{quoted(link.frame.parent)}",
            )


def static_and_dynamic(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        frame = link.frame
        if frame.switched:
            now = "static" if frame.static else "dynamic"
            yield (
                frame.name,
                f"the link has switched between static and dynamic {_times(frame.switched)}; now "
                f"it is {now}, by {_authority(frame.authority)}",
            )


def stopped(facts: TreeFacts) -> Evidence:
    reference, by_clock = facts.reference
    for link in facts.dynamic:
        if is_stopped(link.frame, reference):
            late = age(reference - (link.frame.newest_stamp_ns or 0))
            behind = "old" if by_clock else "behind the newest of the tree"
            yield (
                link.frame.name,
                f"its newest sample is {late} {behind}; they came at {link.frame.rate_hz:.1f} Hz "
                f"from {_authority(link.frame.authority)}",
            )


def sagging(facts: TreeFacts) -> Evidence:
    for link in facts.dynamic:
        rate, gap_s = link.frame.rate_hz, link.longest_gap_s
        if rate is None or gap_s is None or is_stopped(link.frame, facts.reference[0]):
            continue
        if gap_s > max(_GAP_S, _GAP_PERIODS / rate):
            yield (
                link.frame.name,
                f"no sample came for {age(int(gap_s * 1e9))}, although they come at {rate:.1f} Hz "
                f"from {_authority(link.frame.authority)}",
            )


def refused(facts: TreeFacts) -> Evidence:
    for authority in facts.authorities:
        if authority.refused:
            yield (
                authority.name,
                f"{authority.refused:,} of its transforms were refused, the last because: "
                f"{authority.last_refusal}",
            )


def skewed_clock(facts: TreeFacts) -> Evidence:
    for authority in facts.authorities:
        least, greatest = authority.clock_offset_min_s, authority.clock_offset_max_s
        if least is not None and greatest is not None and _is_off(least, greatest):
            yield authority.name, f"its clock is {_lead(least, greatest)}"
    for client in facts.clients:
        least, greatest = client.clock_offset_min_s, client.clock_offset_max_s
        if _is_off(least, greatest):
            where = f" ({client.address})" if client.address else ""
            yield client.client, f"the clock of this client{where} is {_lead(least, greatest)}"


def future_stamps(facts: TreeFacts) -> Evidence:
    reference, by_clock = facts.reference
    if not by_clock:
        return
    for link in facts.dynamic:
        lead_ns = (link.frame.newest_stamp_ns or 0) - reference
        if lead_ns > _AHEAD_S * 1e9:
            yield (
                link.frame.name,
                f"its newest stamp is {age(lead_ns)} ahead of the clock; it is by "
                f"{_authority(link.frame.authority)}",
            )


def repeated_stamps(facts: TreeFacts) -> Evidence:
    for link in facts.dynamic:
        frame, lately = link.frame, facts.grown(link, "rewritten")
        part = _REPEATED_PART * (link.received or frame.samples)
        is_often = frame.rewritten >= max(_REPEATED, part)
        if is_often if lately is None or facts.is_complete else lately >= _REPEATED:
            yield (
                frame.name,
                f"{frame.rewritten:,} samples had a stamp that the link had already"
                f"{_lately(facts, link, 'rewritten')}; it is by {_authority(frame.authority)}",
            )


def too_old(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        if link.frame.dropped:
            yield (
                link.frame.name,
                f"{link.frame.dropped:,} transforms were older than the cache time and dropped",
            )


def time_jumps(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        if link.frame.time_jumps:
            yield (
                link.frame.name,
                f"its history was cleared {_times(link.frame.time_jumps)} as time was set back",
            )


def unconnected(facts: TreeFacts) -> Evidence:
    sizes = sorted(((len(names), root) for root, names in facts.roots.items()), reverse=True)
    if len(sizes) < 2:
        return
    for size, root in sizes[1:]:
        yield (
            root,
            f"this root's tree of {size:,} frames is not connected to the largest one, whose root "
            f"is {quoted(sizes[0][1])}",
        )


def alike_names(facts: TreeFacts) -> Evidence:
    for _, group in groupby(sorted(facts.frames, key=spelling), key=spelling):
        names = sorted(group)
        if len(names) > 1:
            yield names[0], f"these frames differ by slashes or case only: {_listed(names)}"


def deep(facts: TreeFacts) -> Evidence:
    deepest = max(facts.frames, key=facts.depth, default=None)
    if deepest is not None and facts.depth(deepest) > _DEEP:
        yield deepest, f"{facts.depth(deepest):,} links lie between it and its root"


def not_unit(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        if link.norm_error is not None and link.norm_error > _NORM_ERROR:
            yield link.frame.name, f"the norm of a quaternion is {link.norm_error:.4f} off 1"


def _is_off(least_s: float, greatest_s: float) -> bool:
    # Stamps of a simulation or a recording are of no clock.
    return least_s > _AHEAD_S or -CLOCK_RANGE_S < greatest_s < -_BEHIND_S


def _lead(least_s: float, greatest_s: float) -> str:
    if least_s > 0:
        return f"ahead of the server's by {least_s:.3f} to {greatest_s:.3f} s"
    return f"behind the server's by {-greatest_s:.3f} to {-least_s:.3f} s"


def _authority(name: str) -> str:
    return quoted(name) if name else "a publisher without a name"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN:,} more" if len(names) > _SHOWN else ""
    return ", ".join(map(quoted, names[:_SHOWN])) + more


def _times(count: int) -> str:
    return "once" if count == 1 else "twice" if count == 2 else f"{count:,} times"


def _lately(facts: TreeFacts, link: LinkFacts, counter: str) -> str:
    grown = None if facts.is_complete else facts.grown(link, counter)
    return f", {grown:,} of them while it was observed" if grown else ""
