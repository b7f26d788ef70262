"""The sentences of an explanation: what is wrong with a link or a time, and what to do."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from zenoh_tf.introspection.explanation import Explanation, LinkReport
from zenoh_tf.introspection.frame_info import AHEAD_S, AuthorityInfo, FrameInfo, is_post_dated
from zenoh_tf.text import quoted
from zenoh_tf.text.stamp_units import POWERS, other_unit
from zenoh_tf.text.times import CLOCK_RANGE_S, age, seconds

#: A time so far after all stamps, which are of another clock, has not come.
_NOT_COME_NS: Final = 1_000_000_000
#: A move longer ago is not mentioned beside a chain.
_RECENT_NS: Final = 60_000_000_000

OTHER_CLOCK: Final = (
    "The time asked for and the stamps of the chain are of different clocks, such as this "
    "machine's and a simulation's, or a sensor's that counts from its start: use the clock of the "
    "transforms (use_sim_time in ROS)."
)
TOO_EARLY: Final = (
    "Samples arrive with a delay. Give the lookup a time-out and it waits for the next ones, "
    "or leave out the time to get the latest common one."
)


def name(link: LinkReport) -> str:
    """Return a link as its frames."""
    return f"{quoted(link.parent)} -> {quoted(link.child)}"


def mirror_is_lost(source: AuthorityInfo) -> str:
    """Return which robot's mirror is disconnected, of one of its authorities, and for how long."""
    robot = source.name.partition(":")[0]
    return (
        f"the mirror of {robot} is disconnected for {age(round((source.mirror_lost_s or 0) * 1e9))}"
    )


def publisher(link: LinkReport) -> str:
    """Return who publishes a link."""
    return quoted(link.authority) if link.authority else "its publisher, which gave no name,"


def without_stamps(links: Iterable[LinkReport]) -> str | None:
    """Return which of some links has a publisher that fills in no stamps; None if there is none."""
    for link in links:
        if link.newest_stamp_ns == 0:
            return (
                f"All samples of {name(link)} have the stamp 0, so each replaces the one before: "
                f"let {publisher(link)} stamp them with the time of the measurement, or send a "
                "link that never moves as static."
            )
    return None


def outside(link: LinkReport, found: Explanation) -> str:
    """Return by how much a time is off the samples of a link."""
    off_by = age(link.off_by_ns or 0)
    when = f"{seconds(found.at_ns or 0)} s"
    if link.problem == "single_sample":
        return (
            f"{name(link)} has a single sample, and {when} is {off_by} off it: there is nothing "
            "to interpolate between."
        )
    if link.problem == "too_new":
        return f"{when} is {off_by} after the newest sample of {name(link)}."
    return f"{when} is {off_by} before the oldest sample of {name(link)}."


def gap(link: LinkReport) -> str:
    """Return that a link is interpolated over a gap."""
    return (
        f"{name(link)} has no samples for {age(link.gap_ns)} around that time: its pose is "
        "interpolated, not measured."
    )


def too_late(link: LinkReport) -> str:
    """Return what to do about a time that a link has no longer, or has never had."""
    reach = (link.newest_stamp_ns or 0) - (link.oldest_stamp_ns or 0)
    return (
        f"{name(link)} has a history of {age(reach)}. Ask for a later time, sooner, or keep more "
        "(--cache-time, --limit samples_per_frame of the server)."
    )


def recorded_range(found: Explanation, failing: list[LinkReport]) -> str:
    """Return for which times a recording has data of a chain, or in which unit a time is wrong."""
    unit = wrong_unit(found, failing)
    if unit is not None:
        return unit
    links = [link for link in found.links if link.newest_stamp_ns is not None]
    first_ns = max(link.oldest_stamp_ns or 0 for link in links)
    last_ns = min(link.newest_stamp_ns or 0 for link in links)
    if first_ns > last_ns:
        return "The recording has no time for which all links of the chain have data."
    return (
        f"The recording has data of all links of the chain from {seconds(first_ns)} s to "
        f"{seconds(last_ns)} s."
    )


def wrong_unit(found: Explanation, failing: list[LinkReport]) -> str | None:
    """Return which unit a time is in that should be in nanoseconds; None: it is in nanoseconds."""
    oldest = min(link.oldest_stamp_ns or 0 for link in failing)
    newest = max(link.newest_stamp_ns or 0 for link in failing)
    unit = other_unit(found.stamp_ns or 0, oldest, newest)
    if unit is None:
        return None
    return (
        f"The time asked for, {found.stamp_ns}, is in {unit}; times are in nanoseconds. Multiply "
        f"it by 1e{POWERS[unit]} as an integer."
    )


def not_come(found: Explanation, failing: list[LinkReport], reference: int) -> str | None:
    """Return that a time has not come yet; None: it has."""
    at_ns = found.stamp_ns
    if at_ns is None or any(at_ns < (link.newest_stamp_ns or 0) for link in failing):
        return None
    ahead_ns = at_ns - reference
    if found.by_clock and ahead_ns > AHEAD_S * 1e9:
        of = "this machine's clock"
    elif not found.by_clock and ahead_ns > _NOT_COME_NS:
        of = "the newest stamp of the chain"
    else:
        return None
    return (
        f"The time asked for has not come yet: it is {age(ahead_ns)} ahead of {of}. Ask for an "
        "earlier one; if it should have come, check the clock that it is from (zenoh-tf clients, "
        "zenoh-tf authorities)."
    )


def is_ahead(link: LinkReport, found: Explanation) -> bool:
    """Return whether a link's stamps are ahead of the clock."""
    return found.by_clock and link.age_s is not None and link.age_s < -AHEAD_S


def ahead(link: LinkReport, found: Explanation) -> str:
    """Return how far a link's stamps are ahead of the clock."""
    lead = age(-int((link.age_s or 0) * 1e9))
    what = f"The newest sample of {name(link)} is {lead} ahead of the clock"
    if not is_ahead_on_purpose(link, found):
        return f"{what}."
    return (
        f"{what}, but those of the odometry below it are not: a localisation such as AMCL stamps "
        "ahead on purpose (transform_tolerance)."
    )


def no_localisation(link: LinkReport) -> str:
    """Return what to do if stamps are not ahead on purpose."""
    return (
        f"If {publisher(link)} is no localisation, its clock is ahead: zenoh-tf doctor finds "
        "out by the poses."
    )


def wrong_clock(link: LinkReport) -> str:
    """Return what to do about stamps that are ahead of the clock."""
    return (
        f"Check the clock of {publisher(link)}: zenoh-tf authorities shows how far the stamps of "
        "each publisher are ahead."
    )


def is_ahead_on_purpose(link: LinkReport, found: Explanation) -> bool:
    """Return whether a link whose stamps are ahead may be that of a localisation. A chain does not
    show whether it repeats its poses, which is the doctor's other sign."""
    below = (each for each in found.links if each.parent == link.child and each.age_s is not None)
    return is_post_dated(-(link.age_s or 0.0), (-(each.age_s or 0.0) for each in below))


def stopped(link: LinkReport, by_clock: bool) -> str:
    """Return since when a link has stopped."""
    since = age(int((link.age_s or 0) * 1e9))
    behind = "old" if by_clock else "behind the newest of the chain"
    rate = f", and before that they came at {link.rate_hz:.1f} Hz" if link.rate_hz else ""
    return f"{name(link)} has stopped: its newest sample is {since} {behind}{rate}."


def restart(link: LinkReport) -> str:
    """Return what to do about a link that has stopped."""
    return (
        f"Check that {publisher(link)} runs and reaches the server: zenoh-tf authorities counts "
        "what it has sent, and names the reason if the server refused it."
    )


def was_static(link: LinkReport) -> str:
    """Return that a static link was sent as moving."""
    return f"{name(link)} was static until {publisher(link)} sent it as moving."


def publish_static(link: LinkReport) -> str:
    """Return what to do about a link with a single sample."""
    return (
        f"If {quoted(link.child)} never moves in {quoted(link.parent)}, publish the link as "
        f"static. Else check that {publisher(link)} still sends."
    )


def wrong_unit_of(ending: LinkReport, other: LinkReport) -> str | None:
    """Return in which unit the stamps of a link are, beside those of another one; None: they are in
    nanoseconds."""
    other_ns = other.newest_stamp_ns or 0
    unit = other_unit(ending.newest_stamp_ns or 0, other_ns, other_ns)
    if unit is None:
        return None
    return (
        f"The stamps of {name(ending)} are in {unit}; stamps are in nanoseconds. Mend "
        f"{publisher(ending)}: multiply its times by 1e{POWERS[unit]} as integers."
    )


def moves(
    frames: Iterable[FrameInfo], reference: int, by_clock: bool, *, recent: bool
) -> list[str]:
    """Return which frames of a chain have changed their parent, or with `recent` have done so
    lately. Ages are counted from `reference` ns, which may be the clock's time."""
    found = []
    for frame in frames:
        change = frame.last_change
        if change is None or change.kind != "reparented" or change.parent_before is None:
            continue
        ago_ns = reference - change.stamp_ns
        if recent and abs(ago_ns) > _RECENT_NS:
            continue
        since = f"{age(ago_ns)} {'ago' if by_clock else 'before the newest stamp of the chain'}"
        if ago_ns < 0 or ago_ns > CLOCK_RANGE_S * 10**9:
            since = f"at {seconds(change.stamp_ns)} s"
        # A record of a past time has the parent of that time.
        is_past = frame.parent is None or frame.parent == change.parent_before
        to = "another parent" if is_past else quoted(frame.parent or "")
        found.append(
            f"{quoted(frame.name)} moved from {quoted(change.parent_before)} to {to} {since}."
        )
    return found
