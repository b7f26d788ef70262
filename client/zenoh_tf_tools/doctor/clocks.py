"""The checks of stamps and clocks."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Final

from zenoh_tf.introspection.frame_info import AHEAD_S, FrameInfo, is_post_dated
from zenoh_tf.text.stamp_units import other_unit
from zenoh_tf.text.times import CLOCK_RANGE_S, age, seconds
from zenoh_tf_tools.doctor.facts import SIMULATED_NS, LinkFacts, TreeFacts
from zenoh_tf_tools.doctor.words import Evidence, by_publisher, samples, times, window

#: A clock that is late by more is wrong; less may be the delay of messages.
_BEHIND_S: Final = 1.0
#: How far other times are ahead of UTC, since 2017, and the zones of local time apart; and what
#: delays may add.
_AHEAD_OF_UTC_S: Final = {37: "TAI, the time of PTP", 18: "GPS time"}
_ZONE_S: Final = 1800
_DELAY_S: Final = 0.5
#: A localisation that stamps its corrections ahead repeats this part of them.
_REPEATED_POSES: Final = 0.3
#: Samples that show how far a link's stamps are from their arrivals.
_LEAST: Final = 5
#: Repeated stamps: so many while it was observed, or this part of the samples.
_REPEATED: Final = 3
_REPEATED_PART: Final = 0.01
#: Samples come in bursts if there were so many pauses before them.
_BURSTS: Final = 3
#: And if the pauses are this part of the time from the first to the last.
_BURSTS_PART: Final = 0.25
#: The frame and the stamp in the reason of a refused stray (core/commits/commit.cpp).
_STRAY: Final = re.compile(
    r"transform of child '(.+?)' in parent [^;]*?: the stamp (\d+) ns is far"
)


def skewed_clock(facts: TreeFacts) -> Evidence:
    known = set()
    for publisher in facts.authorities:
        least, greatest = publisher.clock_offset_min_s, publisher.clock_offset_max_s
        if least is not None and greatest is not None:
            known.add(publisher.name)
            own = [link for link in facts.dynamic if link.frame.authority == publisher.name]
            if own and all(_is_post_dated(facts, link) for link in own):
                continue
            if _is_off(least, greatest):
                also = _on_purpose(facts, own)
                yield publisher.name, f"its clock is {_lead(least, greatest)}{also}"
    for link, seen in facts.seen:
        timing = seen.timing
        if link.frame.authority in known or timing.arrivals < _LEAST:
            continue
        if timing.least_lead_ns is not None and timing.greatest_lead_ns is not None:
            least, greatest = timing.least_lead_ns / 1e9, timing.greatest_lead_ns / 1e9
            if _is_off(least, greatest) and not _is_post_dated(facts, link):
                ahead = "ahead of" if least > 0 else "behind"
                ends = sorted((abs(least), abs(greatest)))
                yield by_publisher(
                    link,
                    f"its stamps are {ahead} their arrival by {ends[0]:.3f} to {ends[1]:.3f} s"
                    f"{_of_scale(least, greatest)}{_on_purpose(facts, [link])}",
                )
    for client in facts.clients:
        least, greatest = client.clock_offset_min_s, client.clock_offset_max_s
        if _is_off(least, greatest):
            where = f" ({client.address})" if client.address else ""
            yield client.client, f"the clock of this client{where} is {_lead(least, greatest)}"


def future_stamps(facts: TreeFacts) -> Evidence:
    reference, by_clock = facts.reference
    if not by_clock:
        return
    refused = refused_ahead(facts)
    for link in facts.dynamic:
        lead_ns = (link.frame.newest_stamp_ns or 0) - reference
        timing = None if link.seen is None else link.seen.timing
        if timing is not None and timing.strays and timing.stray_lead_ns > AHEAD_S * 1e9:
            yield by_publisher(
                link,
                f"{timing.strays:,} of its {samples(timing.arrivals)} had a stamp far from those "
                f"before and after it, {age(timing.stray_lead_ns)} ahead of the clock",
            )
        elif link.frame.name in refused:
            yield by_publisher(
                link, f"a stamp was {age(refused[link.frame.name])} ahead of the clock, and refused"
            )
        elif (stray := _cleared_stray(facts, link)) is not None:
            yield by_publisher(link, stray)
        elif (
            lead_ns > AHEAD_S * 1e9
            and not is_of_other_epoch(facts, link)
            and not _is_post_dated(facts, link)
        ):
            yield by_publisher(link, f"its newest stamp is {age(lead_ns)} ahead of the clock")


def refused_ahead(facts: TreeFacts) -> dict[str, int]:
    """Return by frame how far ahead of the clock the stamps are that a server refused last as
    strays, in nanoseconds; without those that the clock has passed.

    Args:
        facts: What is known about the tree.
    """
    reference, by_clock = facts.reference
    found: dict[str, int] = {}
    for publisher in facts.authorities if by_clock else ():
        for name, stamp in _STRAY.findall(publisher.last_refusal or ""):
            lead_ns = int(stamp) - reference
            if lead_ns > AHEAD_S * 1e9:
                found[name] = max(found.get(name, 0), lead_ns)
    return found


def repeated_stamps(facts: TreeFacts) -> Evidence:
    for link in facts.dynamic:
        frame, count = link.frame, facts.count(link, "rewritten")
        arrivals = 0 if link.seen is None else link.seen.timing.arrivals
        part = _REPEATED_PART * (arrivals or frame.samples)
        if count >= max(_REPEATED, part):
            since = window(facts, link, "rewritten")
            yield by_publisher(
                link,
                f"{count:,} samples had a stamp that the link had already{since}"
                f"{_without_nanoseconds(frame)}",
            )


def _without_nanoseconds(frame: FrameInfo) -> str:
    """The explanation of repeated stamps by a publisher that fills in their seconds alone."""
    oldest_ns, newest_ns = frame.oldest_stamp_ns or 0, frame.newest_stamp_ns or 0
    if newest_ns == 0:
        return ", which is 0: nobody fills it in"
    span_s, rest_ns = divmod(newest_ns - oldest_ns, 10**9)
    if rest_ns or newest_ns % 10**9 or not 1 < frame.samples <= span_s + 1:
        return ""
    return ", which has whole seconds alone, as if its nanoseconds were lost"


def too_old(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        count = facts.count(link, "dropped")
        if count:
            yield (
                link.frame.name,
                f"{count:,} transforms were older than the cache time and dropped"
                f"{window(facts, link, 'dropped')}",
            )


def time_jumps(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        count = facts.count(link, "time_jumps")
        jump = link.frame.last_time_jump
        if count or (jump is not None and facts.ago_s(jump.at_ns) is not None):
            newest_ns = link.frame.newest_stamp_ns or 0
            is_ahead = jump is not None and newest_ns - jump.newest_stamp_ns > CLOCK_RANGE_S * 1e9
            yield (
                link.frame.name,
                f"its history was cleared {times(count or link.frame.time_jumps)} as time "
                + ("jumped ahead" if is_ahead else "was set back"),
            )


def drift(facts: TreeFacts) -> Evidence:
    found: dict[str, list[float]] = defaultdict(list)
    for link, seen in facts.seen:
        if rate := seen.timing.drift:
            # A recording's topic has links of many computers.
            has_name = link.frame.authority and not facts.is_complete
            found[link.frame.authority if has_name else link.frame.name].append(rate)
    for subject, rates in found.items():
        rate = max(rates, key=abs)
        what = "gain on" if rate > 0 else "fall behind"
        yield subject, f"its stamps {what} the clock by {abs(rate) * 1e3:.1f} ms every second"


def is_of_other_epoch(facts: TreeFacts, link: LinkFacts) -> bool:
    """Return whether a link's stamps are of another clock than those of the other links.

    Args:
        facts: What is known about the tree.
        link: A link that has stamps.
    """
    reference, by_clock = facts.reference
    newest_ns = link.frame.newest_stamp_ns or 0
    if not by_clock or abs(newest_ns - reference) <= CLOCK_RANGE_S * 10**9:
        return False
    came = link.seen is not None and link.seen.timing.arrivals
    return bool(came) or newest_ns > reference or newest_ns < SIMULATED_NS


def other_epoch(facts: TreeFacts) -> Evidence:
    for link in facts.dynamic:
        if is_of_other_epoch(facts, link):
            newest_ns = link.frame.newest_stamp_ns or 0
            unit = other_unit(newest_ns, facts.now_ns, facts.now_ns)
            kind = ""
            if newest_ns == 0:
                kind = ", as of a publisher that fills in no stamps"
            elif newest_ns < SIMULATED_NS:
                kind = ", as of a simulation, or of a sensor that counts from its start"
            if unit is not None:
                kind = f", as of a publisher that gives {unit} as nanoseconds"
            yield by_publisher(
                link,
                f"its newest stamp is {seconds(newest_ns)} s{kind}, but other links have stamps "
                f"of the clock, which is at {seconds(facts.now_ns)} s",
            )


def jitter(facts: TreeFacts) -> Evidence:
    for link, seen in facts.seen:
        if seen.timing.jitter_ns:
            yield by_publisher(
                link,
                f"the delay from stamp to arrival varies by {age(round(seen.timing.jitter_ns))}, "
                "and the stamps are irregular, although they come at "
                f"{link.frame.rate_hz or 0:.1f} Hz",
            )


def backwards(facts: TreeFacts) -> Evidence:
    for link, seen in facts.seen:
        timing = seen.timing
        if timing.backwards:
            yield by_publisher(
                link,
                f"{timing.backwards:,} of {samples(timing.arrivals)} came after newer ones, which "
                f"were up to {age(timing.backwards_ns)} newer",
            )


def bursts(facts: TreeFacts) -> Evidence:
    for link, seen in facts.seen:
        pauses = [pause for pause in facts.pauses(link) if not pause.is_gap]
        waits_ns = [pause.length_ns for pause in pauses]
        if len(pauses) < _BURSTS:
            continue
        if sum(waits_ns) > _BURSTS_PART * (pauses[-1].end_ns - pauses[0].start_ns):
            yield by_publisher(
                link,
                f"nothing came {times(len(waits_ns))} for up to {age(max(waits_ns))}, and then "
                f"samples for all of that time at once, every "
                f"{age(round(seen.timing.period_ns or 0))} by their stamps",
            )


def _cleared_stray(facts: TreeFacts, link: LinkFacts) -> str | None:
    """The evidence of a stamp ahead of the clock, after which the history was cleared."""
    jump = link.frame.last_time_jump
    ago_s = None if jump is None else facts.ago_s(jump.at_ns)
    if jump is None or ago_s is None:
        return None
    lead_ns = jump.newest_stamp_ns - jump.at_ns
    if not AHEAD_S * 1e9 < lead_ns < CLOCK_RANGE_S * 10**9:
        return None
    return (
        f"a stamp was {age(lead_ns)} ahead of the clock {age(max(0, round(ago_s * 1e9)))} ago, and "
        "its history was cleared when samples with earlier stamps followed"
    )


def _on_purpose(facts: TreeFacts, links: list[LinkFacts]) -> str:
    """The other explanation of stamps ahead that each of some links has, which moves all the time:
    a filter that adds a transform tolerance."""
    if not links or not all(
        is_post_dated(_lead_s(facts, link), _leads_below_s(facts, link)) for link in links
    ):
        return ""
    return ", unless it stamps ahead on purpose, as localisations with a transform tolerance do"


def _leads_below_s(facts: TreeFacts, link: LinkFacts) -> Iterator[float]:
    return (_lead_s(facts, e) for e in facts.dynamic if e.frame.parent == link.frame.name)


def _is_post_dated(facts: TreeFacts, link: LinkFacts) -> bool:
    """Whether stamps are ahead on purpose: a localisation repeats its last correction above
    odometry whose stamps are not ahead, or a state publisher sends a pose that never changes beside
    others whose stamps are not ahead."""
    if link.seen is None or link.seen.motion.still_part <= _REPEATED_POSES:
        return False
    others_s = [*_leads_below_s(facts, link)]
    if link.seen.motion.still_part == 1.0:
        authority = link.frame.authority
        others_s += [_lead_s(facts, e) for e in facts.dynamic if e.frame.authority == authority]
    return is_post_dated(_lead_s(facts, link), others_s)


def _lead_s(facts: TreeFacts, link: LinkFacts) -> float:
    return ((link.frame.newest_stamp_ns or 0) - facts.reference[0]) / 1e9


def _is_off(least_s: float, greatest_s: float) -> bool:
    # Stamps of a simulation or a recording are of no clock.
    return AHEAD_S < least_s < CLOCK_RANGE_S or -CLOCK_RANGE_S < greatest_s < -_BEHIND_S


def _lead(least_s: float, greatest_s: float) -> str:
    scale = _of_scale(least_s, greatest_s)
    if least_s > 0:
        return f"ahead of the server's by {least_s:.3f} to {greatest_s:.3f} s{scale}"
    return f"behind the server's by {-greatest_s:.3f} to {-least_s:.3f} s{scale}"


def _of_scale(least_s: float, greatest_s: float) -> str:
    """The explanation of a clock that is off by what another scale of time is ahead of UTC."""
    # The greatest lead has the least delay in it.
    off_s = abs(greatest_s)
    if greatest_s - least_s > _BEHIND_S:
        return ""
    for lead_s, scale in _AHEAD_OF_UTC_S.items():
        if abs(off_s - lead_s) <= _DELAY_S:
            how = "of" if least_s > 0 else "that is corrected twice for"
            return f", as of a clock {how} {scale}, which is {lead_s} s ahead of UTC"
    zones = round(off_s / _ZONE_S)
    if zones and abs(off_s - zones * _ZONE_S) <= _DELAY_S:
        return f", as of local time taken for UTC or the reverse: {zones * _ZONE_S / 3600:g} h"
    return ""
