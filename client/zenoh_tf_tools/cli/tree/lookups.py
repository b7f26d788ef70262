"""``zenoh-tf lookup``, ``latest`` and ``velocity``: the motion of one frame in another."""

from __future__ import annotations

import argparse

from zenoh_tf.text.flag_values import LIVE_TIMES, duration, live_time
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.types import Commands, examples


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    lookup = commands.add_parser(
        "lookup",
        parents=[common],
        help="pose of SOURCE in TARGET at a time, interpolated",
        description="Print the pose of SOURCE in TARGET at a time. Without --at: at the latest "
        "common time, the newest that every link between them can serve.",
        **examples("zenoh-tf lookup map base_link", "zenoh-tf lookup map base_link --at now-0.5s"),
    )
    add_frames(lookup)
    add_at(lookup)
    lookup.set_defaults(run=_lookup)

    latest = commands.add_parser(
        "latest",
        parents=[common],
        help="pose of SOURCE in TARGET from the newest sample of each link",
        description="Print the pose of SOURCE in TARGET from the newest sample of each link, "
        "read in one atomic snapshot.",
        **examples("zenoh-tf latest map gripper"),
    )
    add_frames(latest)
    latest.add_argument(
        "--no-xact",
        dest="transactional",
        action="store_false",
        help="read the links one after another, possibly from different commits",
    )
    latest.set_defaults(run=_latest)

    velocity = commands.add_parser(
        "velocity",
        parents=[common],
        help="how fast TRACKING moves as seen from OBSERVATION",
        description="Print the velocity of TRACKING as seen from OBSERVATION, averaged over an "
        "interval around a time. Without --at: around the latest common time, the newest that "
        "every link between them can serve.",
        **examples(
            "zenoh-tf velocity base_link map",
            "zenoh-tf velocity base_link map --interval 500ms --reference base_link",
        ),
    )
    velocity.add_argument("tracking", metavar="TRACKING", help="the frame that moves")
    velocity.add_argument("observation", metavar="OBSERVATION", help="the frame it is seen from")
    add_at(velocity)
    velocity.add_argument(
        "--interval",
        metavar="DURATION",
        type=duration(),
        default=0.1,
        help="how long to average over (default 100ms)",
    )
    velocity.add_argument(
        "--reference",
        metavar="FRAME",
        help="frame whose axes the velocity is expressed in (default OBSERVATION)",
    )
    velocity.set_defaults(run=_velocity)


def add_frames(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("target", metavar="TARGET", help="the frame to express the pose in")
    parser.add_argument("source", metavar="SOURCE", help="the frame whose pose is asked for")


def add_at(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--at",
        metavar="TIME",
        type=live_time,
        help=LIVE_TIMES,
    )


def _lookup(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        answer = tf.lookup_transform(args.target, args.source, args.at)
    if args.json:
        output.print_json(output.answer_document(answer))
    else:
        print(output.answer_text(answer))
    return 0


def _latest(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        if args.transactional:
            answer = tf.lookup_latest_transform_xact(args.target, args.source)
        else:
            answer = tf.lookup_latest_transform(args.target, args.source)
    if args.json:
        output.print_json(output.answer_document(answer))
    else:
        print(output.answer_text(answer))
    return 0


def _velocity(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        velocity = tf.lookup_velocity(
            args.tracking,
            args.observation,
            args.at,
            args.interval,
            reference_frame=args.reference,
        )
    if args.json:
        output.print_json(output.velocity_document(velocity))
    else:
        print(output.velocity_text(velocity))
    return 0
