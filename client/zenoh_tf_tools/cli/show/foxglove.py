"""``zenoh-tf foxglove``: show the tree live in the Foxglove app."""

from __future__ import annotations

import argparse
import contextlib

from zenoh_tf.text.flag_values import number
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_listen
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.errors import extra
from zenoh_tf_tools.viewer.live import LiveSource


def add(commands: Commands) -> None:
    foxglove = commands.add(
        "foxglove",
        _foxglove,
        "show the tree live in the Foxglove app",
        "Listen for the Foxglove app (its 'Foxglove WebSocket' connection) and send it the newest "
        "sample of each link. Follows a server through a mirror. Runs until Ctrl-C. Needs the "
        "library of zenoh-tf[foxglove].",
        "zenoh-tf foxglove",
        "zenoh-tf foxglove --port 8766 --rate 10",
    )
    add_listen(foxglove, 8765, "the app expects it")
    foxglove.add_argument(
        "--rate",
        metavar="HZ",
        type=number(1, 1000),
        default=50.0,
        help="most samples of a link that are sent each second (default 50): the newest ones",
    )


def _foxglove(args: argparse.Namespace) -> int:
    with extra("foxglove", "foxglove"):
        from zenoh_tf_tools.foxglove_bridge import FoxgloveBridge  # noqa: PLC0415
    with connect(args) as tf, tf.mirror() as mirror:
        bridge = FoxgloveBridge(LiveSource(mirror), f"zenoh-tf {args.tree}", args.host, args.port)
        with contextlib.closing(bridge):
            output.announce(args, args.tree, "ws", bridge.port)
            bridge.run(args.rate)
    return 0
