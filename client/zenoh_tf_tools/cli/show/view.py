"""``zenoh-tf view``: the tree in three dimensions, in a browser."""

from __future__ import annotations

import argparse
import contextlib
import math

from zenoh_tf.text.flag_values import RECORDED_TIMES, duration, number, recorded_time, whole
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli import recorded as recordings
from zenoh_tf_tools.cli.arguments import Commands, add_listen, add_optional_file
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.errors import extra
from zenoh_tf_tools.viewer.live import LiveSource
from zenoh_tf_tools.viewer.recorded import RecordedSource
from zenoh_tf_tools.viewer.source import ViewedTree


def add(commands: Commands) -> None:
    view = commands.add(
        "view",
        _view,
        "show the tree in 3D, in a browser",
        "Show the tree in a browser: frames, links, stale ones, and where frames have been. "
        "Without FILE it follows a server through a mirror. Runs until Ctrl-C. Needs the library "
        "of zenoh-tf[viewer], and for FILE those of zenoh-tf[recordings]; nothing comes from the "
        "internet.",
        "zenoh-tf view",
        "zenoh-tf view run.mcap --at +42.4s",
        "zenoh-tf view --fixed base_link --trail 0",
    )
    add_optional_file(view)
    view.add_argument(
        "--at",
        metavar="TIME",
        type=recorded_time,
        help=f"where to begin in FILE: {RECORDED_TIMES} (default: its first stamp)",
    )
    view.add_argument(
        "--fixed",
        metavar="FRAME",
        help="the frame that stands still (default: the root of most frames)",
    )
    view.add_argument(
        "--stale",
        metavar="DURATION",
        type=duration(),
        default=1.0,
        help="mark links without a sample for this long (default 1s)",
    )
    view.add_argument(
        "--trail",
        metavar="DURATION",
        type=duration(),
        help="how long trails go back (default 10s; of a recording: to its begin)",
    )
    view.add_argument(
        "--axes",
        metavar="M",
        type=number(0.001, 1e6),
        default=0.2,
        help="length of the frames' axes in metres (default 0.2)",
    )
    view.add_argument(
        "--max-frames",
        metavar="N",
        type=whole(1, 10_000),
        default=300,
        help="most frames that are drawn (default 300); the page says how many more there are",
    )
    add_listen(view, 8080, "if it is in use, the next free one")


def _view(args: argparse.Namespace) -> int:
    if args.at is not None and args.file is None:
        args.usage_error("--at chooses a time of a recording: give its FILE")
    with extra("viewer", "viser"):
        from zenoh_tf_tools.viewer.viewer import (  # noqa: PLC0415 - an optional extra
            Options,
            Viewer,
            close_server,
            open_server,
        )
    trail_s = args.trail
    if trail_s is None:
        trail_s = 10.0 if args.file is None else math.inf
    with contextlib.ExitStack() as stack:
        source = _source(args, stack)
        options = Options(
            stale_s=args.stale,
            max_frames=args.max_frames,
            at_ns=_at_ns(args, source),
            fixed=args.fixed,
            axes_m=args.axes,
            trail_s=trail_s,
        )
        server = open_server(args.host, args.port)
        stack.callback(close_server, server)
        port = server.get_port()
        if port != args.port and not args.json:
            print(f"port {args.port} is not free")
        output.announce(args, args.tree if args.file is None else str(args.file), "http", port)
        Viewer(source, server, options).run()
    return 0


def _source(args: argparse.Namespace, stack: contextlib.ExitStack) -> ViewedTree:
    if args.file is not None:
        return recorded(args)
    tf = stack.enter_context(connect(args))
    return LiveSource(stack.enter_context(tf.mirror()))


def _at_ns(args: argparse.Namespace, source: ViewedTree) -> int:
    """The time of a recording to begin at; 0 of a server."""
    range_ns = source.range_ns or (0, 0)
    return recordings.stamp_ns("--at", args.at, range_ns, range_ns[0], inside=True)


def recorded(args: argparse.Namespace) -> RecordedSource:
    """The recording that `args.file` names."""
    with recordings.opened(args) as recording:
        source = RecordedSource(recording)
        recordings.warn(recording)
    return source
