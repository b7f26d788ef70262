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

from zenoh_tf.recordings.writer import RecordingWriter
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_duration
from zenoh_tf_tools.cli.connection import connect
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
        "file without the last second. Needs the libraries of zenoh-tf[recordings].",
        "zenoh-tf record run.mcap",
        "zenoh-tf record run.mcap --for 1min",
    )
    record.add_argument("file", metavar="OUT", type=Path, help="the new file, such as run.mcap")
    add_duration(record, "--for", "end after this long (default: at Ctrl-C)", above=True)


def _record(args: argparse.Namespace) -> int:
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    if args.file.exists():
        raise CommandError(f"{args.file}: the file exists; give another name, or remove it")
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
        return RecordingWriter(args.file, metadata)
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
        (counters.unrepresentable, "transforms left out that ROS 2's messages cannot hold"),
        (counters.removals, "removals of frames or histories, which a recording cannot represent"),
    ):
        if count:
            lines.append(f"{count:,} {text}")
    document = {"file": str(args.file), "bytes": size, **asdict(counters)}
    document["seconds"] = round(spent_s, 3)
    output.show(args, document, "\n".join(lines))
