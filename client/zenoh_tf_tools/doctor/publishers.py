"""The checks of publishers: whether two write one link, and whether their samples come."""

from __future__ import annotations

import re
from typing import Final

from zenoh_tf.introspection.sentences import mirror_is_lost
from zenoh_tf.text import quoted
from zenoh_tf.text.times import CLOCK_RANGE_S, age
from zenoh_tf_tools.doctor.clocks import refused_ahead
from zenoh_tf_tools.doctor.facts import SIMULATED_NS, LinkFacts, TreeFacts
from zenoh_tf_tools.doctor.takeovers import takeovers
from zenoh_tf_tools.doctor.words import Evidence, authority, listed, samples, times, window

#: A link that changes its parent is grasped or released; more often than this, two publishers
#: disagree.
_FLIPS: Final = 3
_FLIPS_PER_S: Final = 0.2
#: A gap in a link's samples, in its periods and in seconds.
_GAP_PERIODS: Final = 10
_GAP_S: Final = 0.5
#: Late lookups say something of a link from this many on: a single one may be the reader's fault.
_LATE_LOOKUPS: Final = 3
#: To wait for a sample that comes soon is usual. On average the newest one may be so old.
_WAIT_S: Final = 0.1
#: A slow link, and how many times as fast another one of its chain is.
_SLOW_HZ: Final = 2.5
_SLOW_SAMPLES: Final = 3
_FASTER: Final = 20
#: A link that was sent once is no link of a slow publisher after so long.
_SENT_ONCE_S: Final = 10.0


def two_publishers(facts: TreeFacts) -> Evidence:
    taken_over = dict(takeovers(facts))
    yield from taken_over.items()
    yield from ((name, text) for name, text in _by_turns(facts) if name not in taken_over)


def _by_turns(facts: TreeFacts) -> Evidence:
    """The links that two authorities write by turns, by what was counted."""
    for link in facts.links:
        frame = link.frame
        changes = facts.count(link, "authority_changes")
        # Whether static values differ is known if they were seen.
        if changes < 2 or (frame.static and link.seen is not None):
            continue
        others = [
            other.name
            for other in facts.authorities
            if other.conflicts and other.name != frame.authority
        ]
        suspects = f"; others that have taken over frames: {listed(others)}" if others else ""
        yield (
            frame.name,
            f"the link has changed hands {times(changes)}"
            f"{window(facts, link, 'authority_changes')}, the last time to "
            f"{authority(frame.authority)}{suspects}",
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
                f"its parent has changed {times(flips)} in {facts.observed_s:.1f} s{between} to "
                f"{quoted(link.frame.parent)}",
            )


def static_and_dynamic(facts: TreeFacts) -> Evidence:
    taken_over = dict(takeovers(facts))  # which TF101 reports, with both publishers
    for link in facts.links:
        frame = link.frame
        if frame.name in taken_over:
            continue
        last = frame.last_change
        is_last = last is not None and last.kind == "switched"
        # A static link's stamp may be any: then it is not known when it was switched.
        is_old = (
            last is not None and last.stamp_ns > SIMULATED_NS and not facts.ago_s(last.stamp_ns)
        )
        if facts.count(link, "switched") or (is_last and not is_old):
            now = "static" if frame.static else "dynamic"
            yield (
                frame.name,
                f"the link has switched between static and dynamic {times(frame.switched)}; now "
                f"it is {now}, by {authority(frame.authority)}",
            )


def stopped(facts: TreeFacts) -> Evidence:
    reference, by_clock = facts.reference
    for link in facts.dynamic:
        if (late_s := _sent_once_ago_s(facts, link)) is not None:
            yield (
                link.frame.name,
                f"its only sample came {age(round(late_s * 1e9))} ago from "
                f"{authority(link.frame.authority)}; publish it as static if it never moves",
            )
        if not facts.has_stopped(link):
            continue
        last_ns = None if link.seen is None else link.seen.timing.last_ns
        if last_ns is None:
            late = age(reference - (link.frame.newest_stamp_ns or 0))
            behind = "old" if by_clock else "behind the newest of the tree"
            since = f"its newest sample is {late} {behind}"
        else:
            since = f"no sample has come for {age(facts.now_ns - last_ns)}"
        yield (
            link.frame.name,
            f"{since}; they came at {link.frame.rate_hz:.1f} Hz "
            f"from {authority(link.frame.authority)}",
        )


def _sent_once_ago_s(facts: TreeFacts, link: LinkFacts) -> float | None:
    """How long ago a link was sent that was never sent again, while another one continues."""
    frame = link.frame
    if frame.samples != 1 or frame.rewritten or frame.evicted:
        return None
    if not facts.is_complete and facts.grown(link, "version"):
        return None
    last_ns = None if link.seen is None else link.seen.timing.last_ns
    if last_ns is not None:
        late_s = (facts.now_ns - last_ns) / 1e9
    else:
        late_s = (facts.reference[0] - (frame.newest_stamp_ns or 0)) / 1e9
    if not _SENT_ONCE_S < late_s < CLOCK_RANGE_S:
        return None
    others = (each for each in facts.dynamic if each.frame.samples > 1)
    return None if all(facts.has_stopped(each) for each in others) else late_s


def lost_mirrors(facts: TreeFacts) -> Evidence:
    lost = {each.name: each for each in facts.authorities if each.mirror_lost_s is not None}
    for link in facts.links:
        source = lost.get(link.frame.authority)
        if source is not None and link.frame.parent is not None:
            yield link.frame.name, f"{mirror_is_lost(source)}; this is its last pose"


def gaps(facts: TreeFacts) -> Evidence:
    shared: list[tuple[float, str, str]] = []
    for link, seen in facts.seen:
        period_ns = seen.timing.period_ns or 0.0
        least_ns = max(_GAP_S * 1e9, _GAP_PERIODS * period_ns)
        found = [p for p in seen.timing.pauses if p.is_gap and p.length_ns > least_ns]
        own = [pause for pause in found if not facts.is_shared(link, pause)]
        pauses = own or [p for p in found if facts.is_shared(link, p, gaps_only=True)]
        if pauses:
            evidence = (
                f"no sample came for {age(max(p.length_ns for p in pauses))}, although they "
                f"come at {1e9 / period_ns:.1f} Hz from {authority(link.frame.authority)}"
            )
            if own:
                yield link.frame.name, evidence
            else:
                shared.append((period_ns, link.frame.name, evidence))
    if shared:  # the length is known best of the fastest link
        _, name, evidence = min(shared)
        yield (
            name,
            f"{evidence}; all fast links paused at once, so look at the publishers' machine, the "
            "server and the recorder",
        )


def refused(facts: TreeFacts) -> Evidence:
    ahead = refused_ahead(facts)  # TF202 has them
    before = {known.name: known.refused for known in facts.authorities_before}
    for publisher in facts.authorities:
        reason = publisher.last_refusal or ""
        frames = re.findall(r"child '([^']+)'", reason)
        if frames and ahead.keys() >= set(frames):
            continue
        grown = publisher.refused - before.get(publisher.name, 0)
        # A static link is sent once: what was refused before is missing still.
        is_missing = any(name not in facts.frames for name in re.findall(r"'([^']+)'", reason))
        # A reset forgets the reason: what was refused before it matters no more.
        if reason and (grown or is_missing):
            yield (
                publisher.name,
                f"{publisher.refused:,} of its transforms were refused, the last because: {reason}",
            )


def slow(facts: TreeFacts) -> Evidence:
    late = dict(_late(facts))
    yield from late.items()
    yield from ((name, evidence) for name, evidence in _slow(facts) if name not in late)


def _late(facts: TreeFacts) -> Evidence:
    """The links that made lookups fail or wait, by what the server has counted."""
    for link in facts.dynamic:
        frame = link.frame
        failures = facts.grown(link, "late_failures") or 0
        waits = facts.grown(link, "late_waits") or 0
        if failures + waits < _LATE_LOOKUPS:
            continue
        late_ns = (facts.grown(link, "late_ns") or 0) / (failures + waits)
        if failures >= _LATE_LOOKUPS or late_ns > _WAIT_S * 1e9:
            rate = f"has {samples(frame.samples)}"
            if frame.rate_hz:
                rate = f"is published at {frame.rate_hz:.1f} Hz"
            yield (
                frame.name,
                f"{failures + waits:,} lookups in {facts.observed_s:.1f} s asked for "
                f"{quoted(frame.parent)} -> {quoted(frame.name)} {age(round(late_ns))} after its "
                f"newest sample on average: {failures:,} failed, {waits:,} waited; it {rate} by "
                f"{authority(frame.authority)}",
            )


def _slow(facts: TreeFacts) -> Evidence:
    """The links whose samples come seldom, beside one of their chain whose samples come often.
    This holds for lookups that no server sees, too."""
    rates = {link.frame.name: _rate_hz(link) for link in facts.dynamic}
    fastest: dict[str, tuple[float, str]] = {}  # of the links that a frame shares a chain with
    for name, rate in rates.items():
        if rate is None:
            continue
        above = facts.ancestors(name)[1:]
        for other in above:
            fastest[other] = max(fastest.get(other, (0.0, "")), (rate, name))
        for other in above:
            other_rate = rates.get(other)
            if other_rate is not None:
                fastest[name] = max(fastest.get(name, (0.0, "")), (other_rate, other))
    for name, rate in rates.items():
        faster_hz, faster = fastest.get(name, (0.0, ""))
        if rate is not None and rate <= _SLOW_HZ and faster_hz >= _FASTER * rate:
            yield (
                name,
                f"its samples come at {rate:.1f} Hz, those of {quoted(faster)} on the same chain "
                f"at {faster_hz:.1f} Hz: a lookup over both waits for up to {1 / rate:.1f} s, or "
                "is as old",
            )


def _rate_hz(link: LinkFacts) -> float | None:
    """The rate of samples that tell one."""
    rate = link.frame.rate_hz
    return rate if link.frame.samples >= _SLOW_SAMPLES else None
