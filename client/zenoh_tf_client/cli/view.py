"""``zenoh-tf frames`` and ``zenoh-tf stats``: what a server holds."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict

from zenoh_tf import FrameInfo
from zenoh_tf_client import TransformClient
from zenoh_tf_client.cli import drawing, output, stamps
from zenoh_tf_client.cli.connection import connect
from zenoh_tf_client.cli.types import Commands


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    frames = commands.add_parser(
        "frames",
        parents=[common],
        help="draw the tree, with age and rate of each link",
        description="Draw the tree of frames, with the age, rate and authority of each link.",
    )
    frames.set_defaults(run=_frames)

    stats = commands.add_parser(
        "stats", parents=[common], help="the server's counters", description="Print the counters."
    )
    stats.set_defaults(run=_stats)


def _frames(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        frames = _frame_infos(tf)
    if args.json:
        records = [asdict(frame) | {"rate_hz": frame.rate_hz} for frame in frames]
        output.print_json({"tree": args.tree, "frames": records})
        return 0
    if not frames:
        print(f"tree {args.tree!r} is empty")
        return 0
    moving = [
        frame.newest_stamp_ns
        for frame in frames
        if frame.newest_stamp_ns is not None and not frame.static
    ]
    now_ns = time.time_ns()
    colour = output.Palette()
    if moving and not stamps.is_clock_time(max(moving)):
        # Recorded or simulated time: against the clock every link would be years old.
        now_ns = max(moving)
        print(colour.faint(f"ages count from the tree's newest stamp, {stamps.seconds(now_ns)} s"))
    for line in drawing.draw(frames, now_ns, colour):
        print(line)
    return 0


def _stats(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        counters = tf.stats()
    if args.json:
        output.print_json(counters)
        return 0
    width = max(map(len, counters), default=0)
    for name, value in sorted(counters.items()):
        print(f"{name:<{width}}  {value:>14,}")
    return 0


def _frame_infos(tf: TransformClient) -> list[FrameInfo]:
    """What the server knows of each frame."""
    names = sorted(tf.frames())
    with tf.batch() as batch:
        handles = [batch.frame(name) for name in names]
    return [handle.result() for handle in handles]
