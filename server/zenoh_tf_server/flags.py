"""The command-line flags of ``zenoh-tf-server`` and the settings that they give.

A module with flags of its own adds them with a function `add_flags(parser)`, as `limit_flags` does.
``python -m zenoh_tf_server.flags > docs/reference/server.md`` writes the page about them.
"""

from __future__ import annotations

import argparse
import functools
import os
import re
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Final

from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import TransformException
from zenoh_tf.text.flag_values import whole
from zenoh_tf.text.time_flags import duration

from . import config_file, limit_flags
from .federation import settings as federation
from .ingest import future_stamps
from .ingest.future_stamps import FutureStamps
from .monitoring import logs, monitoring
from .process import sharing
from .process.sharing import SharingSettings
from .ros2 import settings as ros2
from .security import settings as security
from .settings import ServerSettings
from .state import state
from .state.state import StateSettings

DEFAULT_LISTEN = "tcp/127.0.0.1:7447"

#: More threads only wait for each other.
_MAX_WORKERS: Final = 256

_INTRODUCTION: Final = """\
# Server flags

`zenoh-tf-server --help` prints the same. Each flag may stand in the file of `--config` instead, by
its name without dashes (`cache-time = "30s"`), at the top or in a section; only limits, access
rules and limits of motion have sections of their own ([security](../how-to/security.md),
[limits](limits.md), [estimates](../how-to/estimate.md)). DURATION and BYTES are
[numbers with a unit](commands.md#times-durations-and-numbers).
"""


def parser() -> argparse.ArgumentParser:
    flags = argparse.ArgumentParser(
        prog="zenoh-tf-server",
        # argparse's own text has 20 lines, and each error would stand below it.
        usage="%(prog)s [--listen ENDPOINT] [FLAG ...]; --help lists all flags",
        description="Serve a transform tree over Zenoh.",
        formatter_class=functools.partial(argparse.HelpFormatter, max_help_position=26),
    )
    flags.add_argument("--version", action="version", version=f"%(prog)s {version('zenoh-tf')}")
    flags.add_argument(
        "--config",
        metavar="FILE",
        help="TOML file of flags and access rules; the command line wins (docs/how-to/security.md)",
    )
    _add_network_flags(flags.add_argument_group("network"))
    tree = flags.add_argument_group("tree")
    _add_tree_flags(tree)
    future_stamps.add_flags(tree)
    limit_flags.add_flags(flags)
    state.add_flags(flags)
    sharing.add_flags(flags)
    security.add_flags(flags)
    ros2.add_flags(flags)
    federation.add_flags(flags)
    observed = flags.add_argument_group("logs and metrics (docs/reference/metrics.md)")
    logs.add_flags(observed)
    monitoring.add_flags(observed)
    return flags


def _add_network_flags(flags: argparse._ArgumentGroup) -> None:
    where = flags.add_mutually_exclusive_group()
    where.add_argument(
        "--listen",
        action="append",
        metavar="ENDPOINT",
        help="be a Zenoh router that listens on PROTOCOL/HOST:PORT; repeatable "
        f"(default: {DEFAULT_LISTEN})",
    )
    where.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        help="join the Zenoh network here as a client, and do not listen; repeatable",
    )
    flags.add_argument(
        "--replica-of",
        action="append",
        metavar="ENDPOINT",
        help="be a read-only replica: serve a copy of the tree whose server is here; repeatable "
        "for further endpoints of it (docs/how-to/replicas.md)",
    )
    flags.add_argument(
        "--workers",
        type=whole(1, _MAX_WORKERS),
        default=min(8, max(2, os.cpu_count() or 2)),
        metavar="N",
        help=f"threads per type of request (2 to 8; at most {_MAX_WORKERS})",
    )


def _add_tree_flags(flags: argparse._ArgumentGroup) -> None:
    flags.add_argument(
        "--tree", default="main", metavar="NAME", help="name of the tree (default: %(default)s)"
    )
    flags.add_argument(
        "--cache-time",
        type=duration(above=True),
        default=10.0,
        metavar="DURATION",
        help="history of each frame, back from its newest transform (default: %(default)gs)",
    )
    flags.add_argument(
        "--concurrency",
        choices=("optimistic", "2pl", "giant"),
        default="optimistic",
        metavar="HOW",
        help="optimistic; 2pl: long atomic reads; giant: as tf2",
    )
    flags.add_argument(
        "--one-authority-per-frame",
        action="store_true",
        help="refuse a second authority's transforms of a frame, not only count them",
    )
    flags.add_argument(
        "--time-jump",
        choices=("reject", "clear"),
        default="reject",
        metavar="WHAT",
        help="with a transform older than the cache time: reject it as late, or, at the second "
        "one, clear the frame's history and store it (default: %(default)s)",
    )


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options of a command line and its configuration file. Exits with status 2 and a message
    if something is wrong."""
    flags = parser()
    try:
        options = config_file.parse_arguments(flags, arguments)
    except TransformException as error:
        flags.error(str(error))
    complete(flags, options)
    try:
        options.security = security.from_flags(options, options.access)
    except TransformException as error:
        flags.error(str(error))
    if options.security.authenticates and not options.connect:
        foreign = None
        if ros2.from_flags(options).enabled:
            foreign = "ROS 2 keys"
        elif federation.from_flags(options).patterns:
            foreign = "other trees"
        if foreign is not None:
            flags.error(
                "where clients must prove who they are, this server's router carries no "
                f"{foreign}: join the robots' router with --connect"
            )
    return options


def complete(flags: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Check the flags' values, and fill in where to listen. Exits with status 2 and a message if
    a value is wrong."""
    state.check(flags, options)
    sharing.check(flags, options)
    ros2.check(flags, options)
    federation.check(flags, options)
    try:
        keys.server(options.tree, "")
    except TransformException as error:
        flags.error(f"--tree: {error}")
    if options.replica_of:
        _check_replica(flags, options)
    for flag in ("listen", "connect", "replica_of"):
        for endpoint in getattr(options, flag) or ():
            try:
                zenoh_config.check_endpoint(endpoint)
            except TransformException as error:
                flags.error(f"--{flag.replace('_', '-')}: {error}")
    options.listen = options.listen or [DEFAULT_LISTEN]
    options.connect = options.connect or []
    options.replica_of = options.replica_of or []


def _check_replica(flags: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if a flag contradicts --replica-of."""
    reasons = {
        "connect": "a replica listens for itself: leave --connect out",
        "state_dir": "a replica stores nothing: give --state-dir to the primary",
        "no_admin": "a replica accepts no writes: give --no-admin to the primary",
        "one_authority_per_frame": "a replica accepts no writes: give this flag to the primary",
        "ros2": "a replica accepts no writes: give --ros2 to the primary",
        "ros2_publish": "give --ros2-publish to the primary",
    }
    if options.motion_limits:
        flags.error("a replica has the limits of motion of the primary: declare them there")
    for name, reason in reasons.items():
        if getattr(options, name):
            flags.error(f"--{name.replace('_', '-')} and --replica-of exclude each other: {reason}")


def settings(options: argparse.Namespace) -> ServerSettings:
    """The settings of a server with these flags."""
    return ServerSettings(
        tree=options.tree,
        listen=options.listen,
        connect=options.connect,
        cache_time_s=options.cache_time,
        concurrency=options.concurrency,
        one_authority_per_frame=options.one_authority_per_frame,
        time_jump=options.time_jump,
        workers=options.workers,
        limits=limit_flags.from_flags(options),
        future=FutureStamps(options.max_future_s, options.future),
        security=options.security,
        metrics=options.metrics,
        state=StateSettings(
            options.state_dir, options.state_sync, tuple(dict.fromkeys(options.remember))
        ),
        sharing=SharingSettings(not options.no_share, options.share_dir, options.share_group),
        ros2=ros2.from_flags(options),
        federation=federation.from_flags(options),
        motion_limits=options.motion_limits,
        replica_of=options.replica_of,
    )


def page() -> Iterator[str]:
    """The lines of docs/reference/server.md."""
    yield from _INTRODUCTION.splitlines()
    for group in parser()._action_groups:
        rows = [_row(action) for action in group._group_actions]
        if rows:
            title, _, where = (group.title or "").partition(" (")
            yield from ("", f"## {title[0].upper()}{title[1:]}", "")
            if where:
                yield from (f"See {_linked(where.rstrip(')'))}.", "")
            yield from ("| flag | meaning |", "|---|---|", *rows)


def _row(action: argparse.Action) -> str:
    value = "" if action.nargs == 0 else action.metavar
    optional = action.nargs == "?"
    name = f"{action.option_strings[-1]} {f'[{value}]' if optional else value}".rstrip()
    return f"| `{name}` | {_linked((action.help or '') % vars(action))} |"


def _linked(text: str) -> str:
    """Paths of pages as links from docs/reference."""
    return re.sub(r"docs/([\w/-]*?([\w-]+)\.md)", r"[\2](../\1)", text)


if __name__ == "__main__":
    print("\n".join(page()))
