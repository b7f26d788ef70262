"""``zenoh-tf lookup``, ``latest`` and ``velocity``: the motion of one frame in another."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator

from zenoh_tf import TransformTree
from zenoh_tf.text.time_flags import live_time, recorded_time
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output, recorded
from zenoh_tf_tools.cli.arguments import (
    Commands,
    add_duration,
    add_frames,
    add_max_gap,
)
from zenoh_tf_tools.cli.connection import connect


def add(commands: Commands) -> None:
    lookup = commands.add(
        "lookup",
        _lookup,
        "pose of SOURCE in TARGET at a time, interpolated",
        "Print the pose of SOURCE in TARGET at a time. Without --at: at the latest common time, "
        "the newest that every link between them can serve. FILE needs the libraries of "
        "zenoh-tf[recordings]; for many times of it use query.",
        "zenoh-tf lookup map base_link",
        "zenoh-tf lookup map base_link --at now-0.5s",
        "zenoh-tf lookup run.mcap map base_link --at +10s",
    )
    recorded.add_optional_file(lookup)
    add_frames(lookup)
    recorded.add_at(lookup)
    add_max_gap(lookup)

    latest = commands.add(
        "latest",
        _latest,
        "pose of SOURCE in TARGET from the newest sample of each link",
        "Print the pose of SOURCE in TARGET from the newest sample of each link, read in one "
        "atomic snapshot.",
        "zenoh-tf latest map gripper",
    )
    add_frames(latest)
    latest.add_argument(
        "--no-xact",
        dest="transactional",
        action="store_false",
        help="read the links one after another, possibly from different commits",
    )

    velocity = commands.add(
        "velocity",
        _velocity,
        "how fast TRACKING moves as seen from OBSERVATION",
        "Print the velocity of TRACKING as seen from OBSERVATION, averaged over an interval around "
        "a time. Without --at: around the latest common time, the newest that every link between "
        "them can serve. FILE needs the libraries of zenoh-tf[recordings].",
        "zenoh-tf velocity base_link map",
        "zenoh-tf velocity run.mcap base_link map --at +10s",
        "zenoh-tf velocity base_link map --interval 500ms --reference base_link",
    )
    recorded.add_optional_file(velocity)
    velocity.add_argument("tracking", metavar="TRACKING", help="the frame that moves")
    velocity.add_argument("observation", metavar="OBSERVATION", help="the frame it is seen from")
    recorded.add_at(velocity)
    add_duration(velocity, "--interval", "how long to average over (default 100ms)", 0.1)
    velocity.add_argument(
        "--reference",
        metavar="FRAME",
        help="frame whose axes the velocity is expressed in (default OBSERVATION)",
    )


@contextlib.contextmanager
def tree_at(
    args: argparse.Namespace, *, inside: bool = False
) -> Iterator[tuple[TransformTree | TransformClient, int | None]]:
    """The tree in FILE, or the server's, and the stamp of --at in nanoseconds; None if it is not
    given. `inside`: as of `recorded.stamp_ns`."""
    if args.file is None:
        at_ns = recorded.time_at(args, live_time)
        with connect(args) as tf:
            yield tf, at_ns
    else:
        at = recorded.time_at(args, recorded_time)
        tree, range_ns = recorded.loaded(args)
        with recorded.noting_statics(tree):
            yield tree, at and recorded.stamp_ns("--at", at, range_ns or (0, 0), 0, inside=inside)


def _lookup(args: argparse.Namespace) -> int:
    with tree_at(args) as (tree, stamp_ns):
        answer = tree.lookup_transform(args.target, args.source, stamp_ns, max_gap_s=args.max_gap_s)
        output.show_answer(args, tree, answer)
    return 0


def _latest(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        xact = args.transactional
        look_up = tf.lookup_latest_transform_xact if xact else tf.lookup_latest_transform
        output.show_answer(args, tf, look_up(args.target, args.source))
    return 0


def _velocity(args: argparse.Namespace) -> int:
    frames = (args.tracking, args.observation)
    with tree_at(args, inside=True) as (tree, stamp_ns):
        velocity = tree.lookup_velocity(
            *frames, stamp_ns, args.interval_s, reference_frame=args.reference
        )
        static = not args.json and output.is_static(tree, velocity.stamp_ns, *frames)
    text = output.velocity_text(velocity, static=static)
    output.show(args, output.velocity_document(velocity), text)
    return 0
