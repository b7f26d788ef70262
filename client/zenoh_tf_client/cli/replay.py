"""``zenoh-tf replay``: publish the transforms of a recording."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

from zenoh_tf_client.cli import output
from zenoh_tf_client.cli.connection import connect
from zenoh_tf_client.cli.ingest import Feed
from zenoh_tf_client.cli.progress import Progress
from zenoh_tf_client.cli.recording import Message, open_recording
from zenoh_tf_client.cli.types import Commands, examples


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    replay = commands.add_parser(
        "replay",
        parents=[common],
        help="publish a recording (MCAP, ROS 2 folder, ROS 1 bag)",
        description="Publish the transforms of a recording with their recorded stamps, in the "
        "order of the log, and wait until the server has ingested them. Fails if the server "
        "refuses one of them. Needs the rosbags library.",
        **examples("zenoh-tf replay drive.mcap --rate 1"),
    )
    replay.add_argument("file", metavar="FILE", type=Path)
    replay.add_argument(
        "--rate",
        metavar="N",
        type=_rate,
        default=0.0,
        help="times real speed; 0, the default: as fast as the server ingests it",
    )
    replay.add_argument(
        "--authority",
        metavar="NAME",
        type=_authority,
        default="replay",
        help="publish as this authority (default replay), which nobody else should use meanwhile",
    )
    replay.set_defaults(run=_replay)


def _replay(args: argparse.Namespace) -> int:
    start = time.monotonic()
    # The recording is opened first: a wrong file is reported without a connection.
    with open_recording(args.file) as recording, connect(args) as tf:
        number = 0
        feed = Feed(tf, args.authority, patience_s=args.timeout)
        with Progress(recording.message_count, "messages") as progress:
            messages = recording.messages()
            paced = _paced(messages, args.rate) if args.rate else messages
            for number, message in enumerate(paced, start=1):
                feed.add(message.transforms, static=message.static)
                if args.rate:
                    feed.flush()
                progress.to(number, note=f"{feed.transforms:,} transforms")
            feed.finish()
        no_longer_kept = feed.no_longer_kept()
    spent_s = time.monotonic() - start
    summary = {
        "file": str(args.file),
        "topics": recording.topics,
        "messages": number,
        "transforms": feed.transforms,
        "skipped": recording.skipped,
        "dropped_as_too_old": feed.dropped_as_too_old,
        "no_longer_kept": no_longer_kept,
        "seconds": round(spent_s, 3),
    }
    if args.json:
        output.print_json(summary)
    else:
        print(
            f"{feed.transforms:,} transforms of {number:,} messages ingested in {spent_s:.1f} s "
            f"({', '.join(recording.topics)})"
        )
        if recording.skipped:
            print(f"{recording.skipped:,} skipped: not valid transforms")
        if feed.dropped_as_too_old:
            print(
                f"{feed.dropped_as_too_old:,} of them dropped on arrival: older than the server's "
                "cache time"
            )
        if no_longer_kept:
            print(
                f"{no_longer_kept:,} of them no longer kept: newer ones of the same frames have "
                "pushed them out of the server's cache (--cache-time, --max-samples-per-frame)"
            )
    return 0


def _paced(messages: Iterator[Message], rate: float) -> Iterator[Message]:
    """The messages, each delayed until its time at `rate` times real speed."""
    first_ns: int | None = None
    start = time.monotonic()
    for message in messages:
        first_ns = message.log_ns if first_ns is None else first_ns
        due = start + (message.log_ns - first_ns) / 1e9 / rate
        time.sleep(max(0.0, due - time.monotonic()))
        yield message


def _authority(text: str) -> str:
    if not text:
        raise argparse.ArgumentTypeError("the name is empty; the server counts by authority")
    return text


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = -1.0
    if not 0.0 <= rate < 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of at least 0 and below 1e6")
    return rate
