"""``zenoh-tf foxglove``: show the tree live in the Foxglove app."""

from __future__ import annotations

import argparse
import contextlib
from typing import Final

from zenoh_tf.text.flag_values import number, whole
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.types import Commands, examples
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.viewer.live import LiveSource

_EXAMPLES: Final = (
    "zenoh-tf foxglove",
    "zenoh-tf foxglove --port 8766 --rate 10",
)


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    foxglove = commands.add_parser(
        "foxglove",
        parents=[common],
        help="show the tree live in the Foxglove app",
        description="Listen for the Foxglove app (its 'Foxglove WebSocket' connection) and send it "
        "the newest sample of each link. Follows a server through a mirror. Runs until Ctrl-C. "
        "Needs the library of zenoh-tf[foxglove].",
        **examples(*_EXAMPLES),
    )
    foxglove.add_argument(
        "--host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address to listen on (default 127.0.0.1: only this machine)",
    )
    foxglove.add_argument(
        "--port",
        metavar="N",
        type=whole(1, 65_535),
        default=8765,
        help="port to listen on (default 8765, which the app expects)",
    )
    foxglove.add_argument(
        "--rate",
        metavar="HZ",
        type=number(1, 1000),
        default=50.0,
        help="most samples of a link that are sent each second (default 50): the newest ones",
    )
    foxglove.set_defaults(run=_foxglove)


def _foxglove(args: argparse.Namespace) -> int:
    try:
        from zenoh_tf_tools.foxglove_bridge import FoxgloveBridge  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != "foxglove":
            raise
        raise CommandError(
            "this command sends through foxglove-sdk, which is not installed; "
            "install it with: pip install 'zenoh-tf[foxglove]'"
        ) from error
    with connect(args) as tf, tf.mirror() as mirror:
        bridge = FoxgloveBridge(LiveSource(mirror), f"zenoh-tf {args.tree}", args.host, args.port)
        with contextlib.closing(bridge):
            url = output.url("ws", args.host, bridge.port)
            if args.json:
                output.print_json({"url": url, "showing": args.tree})
            else:
                print(f"showing {args.tree} at {url} (Ctrl-C ends it)", flush=True)
            bridge.run(args.rate)
    return 0
