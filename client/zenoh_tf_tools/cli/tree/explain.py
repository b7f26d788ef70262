"""``zenoh-tf explain``: why a lookup succeeds or fails."""

from __future__ import annotations

import argparse

from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_at, add_frames
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.errors import FAULT_FOUND


def add(commands: Commands) -> None:
    explain = commands.add(
        "explain",
        _explain,
        "say why a lookup fails or is old, and what to do",
        "Print the chain between two frames link by link, read at one instant, which link limits "
        "the lookup, why it fails if it does, and what to do. Exit code 3 if it fails.",
        "zenoh-tf explain map camera",
        "zenoh-tf explain map camera --at now-0.5s",
    )
    add_frames(explain)
    add_at(explain)


def _explain(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        found = tf.explain(args.target, args.source, args.at)
    output.show(args, found.document(), found.text(output.paint))
    return 0 if found.possible else FAULT_FOUND
