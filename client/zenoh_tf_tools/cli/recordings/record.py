"""``zenoh-tf record``: write every committed sample into a file."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Final

from zenoh_tf.recordings.repair import repair
from zenoh_tf.recordings.writer import RecordingWriter
from zenoh_tf.text.times import seconds
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_duration
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.progress import Progress
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.recorder import Counters, Recorder

_PERIOD_S: Final = 0.5
#: A server without commits sends ten heartbeats a second.
_SILENT_S: Final = 2.0


def add(commands: Commands) -> None:
    record = commands.add(
        "record",
        _record,
        "write every committed transform into an MCAP file",
        "Write the tree's static links, the history that the server has, and then every committed "
        "transform into a new MCAP file, until Ctrl-C. A recorder that is killed leaves a readable "
        "file without the last second. --repair needs no server: it writes what can be read of a "
        "damaged MCAP file, whoever recorded it, into a new one with an index, and counts what is "
        "lost. Needs the libraries of zenoh-tf[recordings].",
        "zenoh-tf record run.mcap",
        "zenoh-tf record run.mcap --format foxglove --for 1min",
        "zenoh-tf record fixed.mcap --repair crashed.mcap",
    )
    record.add_argument("file", metavar="OUT", type=Path, help="the new file, such as run.mcap")
    record.add_argument(
        "--repair",
        metavar="FILE",
        type=Path,
        help="write what can be read of this damaged MCAP file, in place of a recording",
    )
    record.add_argument(
        "--format",
        choices=("ros2", "foxglove"),
        help="messages of the type tf2_msgs/msg/TFMessage, as ros2 bag records them (default "
        "ros2), or foxglove.FrameTransforms, which also hold stamps beyond 2038",
    )
    add_duration(record, "--for", "end after this long (default: at Ctrl-C)", above=True)


def _record(args: argparse.Namespace) -> int:
    if args.repair is not None:
        if args.format is not None or args.for_s is not None:
            args.usage_error("--repair cannot be combined with --format or --for")
        return _repair(args)
    args.format = args.format or "ros2"
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    _check_new(args.file)
    begin_s = time.monotonic()
    with connect(args) as tf:
        writer = _writer(args, tf)
        recorder = Recorder(tf, writer)
        try:
            recorder.wait_for_copy(args.timeout)
        except BaseException:
            recorder.close()
            args.file.unlink()
            raise
        _wait(args, recorder, stop)
        try:
            recorder.close()
        except OSError as error:
            raise CommandError(
                f"{args.file}: cannot be written: {error.strerror}; what it has can be read"
            ) from error
    _print(args, recorder.counters, time.monotonic() - begin_s)
    return 0


def _writer(args: argparse.Namespace, tf: TransformClient) -> RecordingWriter:
    metadata = {"tree": args.tree, "server": tf.instance}
    try:
        return RecordingWriter(args.file, args.format, metadata)
    except OSError as error:
        raise CommandError(f"{args.file}: cannot be written: {error.strerror}") from error


def _wait(args: argparse.Namespace, recorder: Recorder, stop: threading.Event) -> None:
    """Wait for the end, and report what happens meanwhile."""
    begin_s = time.monotonic()
    end_s = begin_s + (math.inf if args.for_s is None else args.for_s)
    is_silent, servers = False, recorder.counters.servers
    if not args.json:
        end = "Ctrl-C" if args.for_s is None else f"{args.for_s:g} s have passed, or Ctrl-C"
        print(f"recording to {args.file} until {end}", file=sys.stderr)
    while not stop.wait(max(0.0, min(_PERIOD_S, end_s - time.monotonic()))):
        if time.monotonic() >= end_s or recorder.error is not None:
            return
        if recorder.counters.servers != servers:
            servers = recorder.counters.servers
            print("zenoh-tf: another server has the tree; recording continues", file=sys.stderr)
        was_silent, is_silent = is_silent, recorder.age_s() > _SILENT_S
        if is_silent and not was_silent:
            print("zenoh-tf: the server is silent; waiting for it", file=sys.stderr)


def _check_new(path: Path) -> None:
    if path.exists():
        raise CommandError(f"{path}: the file exists; give another name, or remove it")


def _repair(args: argparse.Namespace) -> int:
    _check_new(args.file)
    try:
        with Progress(args.repair.stat().st_size, "bytes") as progress:
            found = repair(args.repair, args.file, progress.to)
    except OSError as error:
        raise CommandError(f"{error.filename or args.file}: {error.strerror}") from error
    size = args.file.stat().st_size
    lines = [
        f"{found.messages:,} messages of {args.repair} written to {args.file} ({size:,} bytes)"
    ]
    if found.lost_from_ns is not None and found.lost_to_ns is not None:
        lines.append(
            f"the last chunk is not complete: messages from {seconds(found.lost_from_ns)} s to "
            f"{seconds(found.lost_to_ns)} s are lost"
        )
    if found.lost_messages:
        lines.append(f"{found.lost_messages:,} messages are lost in chunks that are damaged")
    lost = f"{found.lost_bytes:,} bytes, {found.lost_chunks:,} chunks" if found.lost_bytes else ""
    lines.append(f"lost: {lost or 'nothing; only the end of the file was missing'}")
    document = {"file": str(args.file), "bytes": size, **asdict(found)}
    output.show(args, document, "\n".join(lines))
    return 0


def _print(args: argparse.Namespace, counters: Counters, spent_s: float) -> None:
    size = args.file.stat().st_size
    lines = [
        f"{counters.transforms:,} transforms and {counters.static:,} static ones in {spent_s:.1f} "
        f"s written to {args.file} ({size:,} bytes)"
    ]
    for count, text in (
        (counters.dropped, "transforms dropped: the disk was too slow"),
        (
            counters.missed_commits,
            "commits missed at most: the connection was cut, or this machine too slow",
        ),
        (
            counters.unrepresentable,
            f"transforms left out that the format {args.format} cannot hold",
        ),
        (counters.removals, "removals of frames or histories, which a recording cannot represent"),
    ):
        if count:
            lines.append(f"{count:,} {text}")
    summary = {"file": str(args.file), "format": args.format, "bytes": size}
    document = {**summary, **asdict(counters), "seconds": round(spent_s, 3)}
    output.show(args, document, "\n".join(lines))
