"""``zenoh-tf replay``: publish the transforms of a recording."""

from __future__ import annotations

import argparse
import functools
import sys
import time
from collections.abc import Iterator

from zenoh_tf import ServerUnavailable, StampedTransform, Transform
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings import Recording
from zenoh_tf.recordings.load import valid_commits
from zenoh_tf.text.flag_values import number
from zenoh_tf.text.time_flags import RECORDED_TIMES
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.arguments import Commands
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.progress import Progress
from zenoh_tf_tools.cli.recordings.ingest import Feed, ServerWasRestarted
from zenoh_tf_tools.cli.recordings.playback import Playback


def add(commands: Commands) -> None:
    replay = commands.add(
        "replay",
        _replay,
        "publish a recording (MCAP, db3, ROS 1 bag)",
        "Publish the transforms of a recording in the order of its log, and wait until the server "
        "has ingested them. Fails at the end if it has refused some of them. Needs the libraries "
        "of zenoh-tf[recordings].",
        "zenoh-tf replay run.mcap",
        "zenoh-tf replay run.mcap --rate 10 --start +10s --end +20s",
        "zenoh-tf replay run.mcap --loop --clock now",
    )
    recorded.add_file(replay)
    replay.add_argument(
        "--rate",
        metavar="N",
        type=number(0.0, 1e6),
        help="times real speed; 0: as fast as the server ingests it (default 0; 1 with --loop or "
        "--clock now)",
    )
    replay.add_argument(
        "--loop",
        action="store_true",
        help="start over at the end, until Ctrl-C; the stamps of each turn follow the last turn's. "
        "Continues with a server that was restarted",
    )
    recorded.add_range(
        replay,
        f"{{0}} stamp of what is published: {RECORDED_TIMES}; static transforms are published all "
        "the same",
    )
    replay.add_argument(
        "--clock",
        choices=("recorded", "now"),
        default="recorded",
        help="stamps as recorded (default), or moved as if it happened now",
    )
    replay.add_argument(
        "--authority",
        metavar="NAME",
        type=_authority,
        default="replay",
        help="publish as this authority (default replay), which nobody else should use meanwhile",
    )


def _replay(args: argparse.Namespace) -> int:
    playback = _playback(args)
    start = time.monotonic()
    # The recording is opened first: a wrong file is reported without a connection.
    with recorded.opened(args) as recording:
        recording.check_links()  # before anything is published
        _choose_part(args, recording, playback)
        with connect(args) as tf:
            on_lost = functools.partial(_report_lost, args) if args.loop else None
            feed = Feed(tf, args.authority, args.timeout, on_lost)
            number, topics = _play(recording, playback, feed)
            while args.loop:
                _play(recording, playback, feed)
            no_longer_kept = feed.no_longer_kept()
            recorded.warn(recording)
    if (refusal := feed.refusal()) is not None:
        raise refusal
    spent_s = time.monotonic() - start
    summary = {
        "file": str(args.file),
        "topics": topics,
        "messages": number,
        "transforms": feed.transforms,
        "skipped": recording.skipped,
        "malformed": recording.malformed,
        "cut_off": recording.is_cut_off,
        "strays": feed.strays,
        "dropped_as_too_old": feed.dropped_as_too_old,
        "no_longer_kept": no_longer_kept,
        "seconds": round(spent_s, 3),
    }
    lines = [
        f"{feed.transforms:,} transforms of {number:,} messages ingested in {spent_s:.1f} s "
        f"({', '.join(topics)})"
    ]
    if feed.strays:
        lines.append(
            f"{feed.strays:,} of them refused as strays: far ahead of what the server had of their "
            "frames, until more of them followed"
        )
    if feed.dropped_as_too_old:
        lines.append(
            f"{feed.dropped_as_too_old:,} of them dropped on arrival: older than the server's "
            "cache time"
        )
    if no_longer_kept:
        lines.append(
            f"{no_longer_kept:,} of them no longer kept: newer ones of the same frames have "
            "pushed them out of the server's cache (--cache-time, --limit samples_per_frame)"
        )
    output.show(args, summary, "\n".join(lines))
    return 0


def _playback(args: argparse.Namespace) -> Playback:
    now = args.clock == "now"
    rate = (1.0 if args.loop or now else 0.0) if args.rate is None else args.rate
    if not rate and (args.loop or now):
        args.usage_error("--loop and --clock now need a --rate above 0")
    return Playback(rate, now=now)


def _choose_part(args: argparse.Namespace, recording: Recording, playback: Playback) -> None:
    """Set the first and last stamp to play. Reads the recording, as they count from its stamps."""
    if args.start is None and args.end is None:
        return
    range_ns = recorded.range_of(recording) or (0, 0)
    default = playback.start_ns, playback.end_ns
    playback.start_ns, playback.end_ns = recorded.chosen_range(args, range_ns, default, inside=True)


def _play(recording: Recording, playback: Playback, feed: Feed) -> tuple[int, list[str]]:
    """Play the recording once; returns the number of messages and their topics."""
    validator = recorded.validator()
    number, topics = 0, set[str]()
    with Progress(recording.message_count, "messages") as progress:
        for number, message in enumerate(playback.turn(recording.messages()), start=1):
            topics.add(message.topic)
            for rows in valid_commits(recording, validator, message.rows, message.static):
                feed.add(_stampeds(rows), static=message.static)
            if playback.rate:
                feed.flush()
            progress.to(number, note=f"{feed.transforms:,} transforms")
        feed.finish()
    return number, sorted(topics)


def _report_lost(args: argparse.Namespace, error: ServerUnavailable | ServerWasRestarted) -> None:
    if isinstance(error, ServerUnavailable):
        output.report_waiting(error, args.json)
    else:
        print("zenoh-tf: the server was restarted; replay continues", file=sys.stderr, flush=True)


def _stampeds(rows: TransformRows) -> Iterator[StampedTransform]:
    names = rows.names
    columns = (rows.parent, rows.child, rows.stamp, rows.pose)
    for parent, child, stamp_ns, pose in zip(*(c.tolist() for c in columns), strict=True):
        yield StampedTransform(names[parent], names[child], stamp_ns, Transform(pose[:3], pose[3:]))


def _authority(text: str) -> str:
    if not text:
        raise argparse.ArgumentTypeError("the name is empty; the server counts by authority")
    return text
