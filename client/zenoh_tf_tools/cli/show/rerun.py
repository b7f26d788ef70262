"""``zenoh-tf rerun``: show a tree, live or of a recording, in the Rerun viewer."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from zenoh_tf.text import printable
from zenoh_tf.text.flag_values import number
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli import recorded as recordings
from zenoh_tf_tools.cli.arguments import Commands, add_scene
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.progress import Progress
from zenoh_tf_tools.cli.show.view import recorded
from zenoh_tf_tools.errors import CommandError, extra
from zenoh_tf_tools.viewer.live import LiveSource
from zenoh_tf_tools.viewer.source import ViewedTree

if TYPE_CHECKING:
    import rerun as rr

    from zenoh_tf_tools.rerun_log import RerunLog

#: How long a viewer may take to answer, in seconds.
_CONNECT_S = 10.0


def add(commands: Commands) -> None:
    rerun = commands.add(
        "rerun",
        _rerun,
        "show the tree in the Rerun viewer",
        "Log the tree to Rerun, with the names of its frames. All links of FILE are interpolated "
        "to the same instants; without FILE the newest samples of a server are sent, until Ctrl-C. "
        "Starts the viewer, unless --save or --viewer is given. Needs the library of "
        "zenoh-tf[rerun], and for FILE those of zenoh-tf[recordings].",
        "zenoh-tf rerun",
        "zenoh-tf rerun run.mcap --save run.rrd --urdf robot.urdf",
    )
    recordings.add_optional_file(rerun)
    rerun.add_argument(
        "--save", metavar="RRD", type=Path, help="write this file; no viewer is needed"
    )
    rerun.add_argument(
        "--viewer", metavar="URL", help="a viewer that runs: rerun+http://HOST:9876/proxy"
    )
    rerun.add_argument(
        "--rate",
        metavar="HZ",
        type=number(0.001, 1000),
        default=50.0,
        help="instants a second of FILE, or most samples a second of a live link (default 50)",
    )
    add_scene(rerun, 0.1)


def _rerun(args: argparse.Namespace) -> int:
    if args.save is not None and args.viewer is not None:
        args.usage_error("--save writes a file, --viewer sends to a viewer: give one of them")
    with extra("rerun", "rerun"):
        import rerun as rr  # noqa: PLC0415 - an optional extra

        from zenoh_tf_tools.rerun_log import RerunLog  # noqa: PLC0415
    with contextlib.ExitStack() as stack:
        if args.file is not None:
            source: ViewedTree = recorded(args)
            name = args.file.name
        else:
            source = LiveSource(stack.enter_context(stack.enter_context(connect(args)).mirror()))
            name = args.tree
        stream = rr.RecordingStream("zenoh-tf")
        stream.send_recording_name(name)
        log = RerunLog(source, stream, args.urdf, args.fixed, args.axes)
        _open(args, stream)
        stack.callback(stream.disconnect)
        if source.range_ns is not None:
            _all(log, source.range_ns, args.rate)
        else:
            where = args.save or args.viewer or "the Rerun viewer"
            output.show(
                args,
                {"showing": name, "in": str(where)},
                f"showing {printable(name)} in {where} (Ctrl-C ends it)",
            )
            sys.stdout.flush()
            _live(log, source, args.rate)
    return 0


def _open(args: argparse.Namespace, stream: rr.RecordingStream) -> None:
    try:
        if args.save is not None:
            stream.save(args.save)
        elif args.viewer is not None:
            stream.connect_grpc(args.viewer)
        else:
            # The viewer is installed beside Python, which need not be in the path.
            here = str(Path(sys.executable).parent)
            os.environ["PATH"] = os.pathsep.join((os.environ.get("PATH", os.defpath), here))
            stream.spawn()
        stream.flush(timeout_sec=_CONNECT_S)
    except (OSError, RuntimeError, ValueError) as error:
        raise CommandError(f"cannot log to Rerun: {str(error).splitlines()[0]}") from error


def _all(log: RerunLog, range_ns: tuple[int, int], rate_hz: float) -> None:
    first_ns, last_ns = range_ns
    period_ns = 1e9 / rate_hz
    instants = int((last_ns - first_ns) / period_ns) + 1
    with Progress(instants, "instants") as progress:
        for i in range(instants):
            log.step(first_ns + round(i * period_ns), past=True)
            progress.to(i)
        log.step(last_ns, past=True)
    log.send()


def _live(log: RerunLog, source: ViewedTree, rate_hz: float) -> None:
    time_ns = source.now_ns([])
    while True:
        start_s = time.monotonic()
        time_ns = source.now_ns(log.step(time_ns, past=False))
        log.send()
        time.sleep(max(1 / rate_hz - (time.monotonic() - start_s), 0.001))
