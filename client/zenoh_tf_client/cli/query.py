"""``zenoh-tf lookup`` and ``zenoh-tf latest``: where one frame is in another."""

from __future__ import annotations

import argparse

from zenoh_tf_client.cli import output, stamps
from zenoh_tf_client.cli.connection import connect
from zenoh_tf_client.cli.types import Commands


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    lookup = commands.add_parser(
        "lookup",
        parents=[common],
        help="pose of SOURCE in TARGET at a time, interpolated",
        description="Print the pose of SOURCE in TARGET at a time; without --at, at the newest "
        "time that every link between them can serve.",
    )
    _add_frames(lookup)
    lookup.add_argument(
        "--at",
        metavar="STAMP",
        type=stamps.parse,
        help="nanoseconds; seconds as 1700000000.5 or 12s; now; or now-0.5s",
    )
    lookup.set_defaults(run=_lookup)

    latest = commands.add_parser(
        "latest",
        parents=[common],
        help="pose of SOURCE in TARGET from every link's newest sample",
        description="Print the pose of SOURCE in TARGET from the newest sample of every link, "
        "read in one atomic snapshot.",
    )
    _add_frames(latest)
    latest.add_argument(
        "--no-xact",
        dest="transactional",
        action="store_false",
        help="read link by link: links may then be of different commits",
    )
    latest.set_defaults(run=_latest)


def _add_frames(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("target", metavar="TARGET", help="the frame to express the pose in")
    parser.add_argument("source", metavar="SOURCE", help="the frame whose pose is asked for")


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
