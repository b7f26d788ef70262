"""What the commands that read recordings have in common."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from zenoh_tf.recordings import Recording, RecordingError, open_recording
from zenoh_tf.text import printable
from zenoh_tf_tools.errors import CommandError


def add_file(parser: argparse.ArgumentParser) -> None:
    """Add the recording, and what to read of it."""
    parser.add_argument(
        "file", metavar="FILE", type=Path, help="MCAP, db3 or bag file, or a ROS 2 folder"
    )
    parser.add_argument(
        "--topic",
        metavar="NAME",
        dest="topics",
        action="append",
        help="read only this topic, such as /robot1/tf; may be given several times (default: all "
        "topics with transforms)",
    )


@contextmanager
def opened(args: argparse.Namespace) -> Iterator[Recording]:
    """The recording that the arguments name. Its errors become CommandError."""
    try:
        with open_recording(args.file, args.topics) as recording:
            yield recording
    except RecordingError as error:
        raise CommandError(str(error)) from error


def warn(recording: Recording) -> None:
    """Print on stderr what is worth telling about what was read."""
    for warning in recording.warnings():
        print(f"zenoh-tf: {printable(warning)}", file=sys.stderr)
