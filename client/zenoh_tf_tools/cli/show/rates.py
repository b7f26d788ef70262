"""What a tree does in a period: rates and delays of links and authorities."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from zenoh_tf import AuthorityInfo, FrameInfo, ServerUnavailable
from zenoh_tf.introspection.explain import is_stopped
from zenoh_tf.text.times import CLOCK_RANGE_S, reference_ns
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.records import watch_frames
from zenoh_tf_tools.cli.show.pair_delays import PairDelay, PairWatch


@dataclass(frozen=True)
class LinkRate:
    """A dynamic link in a period.

    ``commits_per_s``: how often it was written. ``rate_hz``: of its history, by the stamps.
    ``least_age_s`` and ``greatest_age_s``: of its newest stamp; the least is about the delay from
    the measurement to the server. None for stamps that are of another clock. ``stopped``: as of
    `zenoh_tf.introspection.explain.is_stopped`.
    """

    frame: str
    parent: str
    authority: str
    commits_per_s: float
    rate_hz: float | None
    least_age_s: float | None
    greatest_age_s: float | None
    stopped: bool


@dataclass(frozen=True)
class AuthorityRate:
    """An authority in a period. Counts are of the period; ``lead_max_s`` is `AuthorityInfo`'s."""

    authority: str
    commits_per_s: float
    transforms_per_s: float
    dropped: int
    refused: int
    lead_max_s: float | None


@dataclass(frozen=True)
class Period:
    """What happened in ``seconds``."""

    seconds: float
    static_links: int
    links: Sequence[LinkRate]
    authorities: Sequence[AuthorityRate]
    pairs: Sequence[PairDelay] = ()


def periods(
    tf: TransformClient,
    args: argparse.Namespace,
    on_lost: Callable[[ServerUnavailable], object],
) -> Iterator[Period]:
    """Watch a tree for as many periods as the options say.

    `on_lost`: called with the reason when the server has ended; then one that comes is awaited.
    """
    watched, is_lost = 0, False
    while watched != args.count:
        try:
            period = watch(tf, args.every_s, args.pairs)
        except ServerUnavailable as error:
            if not is_lost:
                on_lost(error)
            is_lost = True
            time.sleep(args.every_s)
            continue
        is_lost = False
        yield period
        watched += 1


def watch(tf: TransformClient, period_s: float, pairs: Sequence[Sequence[str]] = ()) -> Period:
    """Watch a tree for a period; `pairs`: of (target, source) whose delays are wanted."""
    start_s = time.monotonic()
    publishers = {each.name: each for each in tf.authorities()}
    ages: dict[str, list[float]] = {}
    before: dict[str, FrameInfo] = {}
    now: dict[str, FrameInfo] = {}
    pair_watches = [PairWatch((target, source)) for target, source in pairs]
    for frames in watch_frames(tf, period_s):
        clock_ns = time.time_ns()
        for frame in frames:
            age_s = frame.delay_s(clock_ns)
            if age_s is not None and abs(age_s) <= CLOCK_RANGE_S:
                ages.setdefault(frame.name, []).append(age_s)
        now = {frame.name: frame for frame in frames}
        before = before or now
        for pair in pair_watches:
            pair.add(now, clock_ns)
    seconds = time.monotonic() - start_s
    stamps = [f.newest_stamp_ns for f in now.values() if not f.static and f.newest_stamp_ns]
    reference, _ = reference_ns(stamps, time.time_ns())
    links = [
        _link(frame, before.get(frame.name, frame), ages.get(frame.name), seconds, reference)
        for frame in now.values()
        if frame.parent is not None and not frame.static
    ]
    static = sum(frame.static for frame in now.values())
    authorities = [
        _authority(each, publishers.get(each.name, _new(each)), seconds)
        for each in tf.authorities()
    ]
    delays = [pair.result() for pair in pair_watches]
    return Period(seconds, static, links, authorities, delays)


def _link(
    frame: FrameInfo, before: FrameInfo, ages: list[float] | None, seconds: float, reference: int
) -> LinkRate:
    commits = max(0, frame.commits - before.commits)
    return LinkRate(
        frame.name,
        frame.parent or "",
        frame.authority,
        commits / seconds,
        frame.rate_hz,
        min(ages) if ages else None,
        max(ages) if ages else None,
        is_stopped(frame, reference),
    )


def _authority(now: AuthorityInfo, before: AuthorityInfo, seconds: float) -> AuthorityRate:
    return AuthorityRate(
        now.name,
        max(0, now.commits - before.commits) / seconds,
        max(0, now.stored - before.stored) / seconds,
        max(0, now.dropped - before.dropped),
        max(0, now.refused - before.refused),
        now.clock_offset_max_s,
    )


def _new(authority: AuthorityInfo) -> AuthorityInfo:
    """What an authority was before its first commit."""
    return AuthorityInfo(authority.name, 0, 0, 0, 0, 0, 0)
