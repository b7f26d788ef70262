"""The command line of ``zenoh-tf-server`` and the settings that it gives.

``python -m zenoh_tf_server.flags > docs/reference/server.md`` writes the page about the flags.
"""

from __future__ import annotations

import argparse
import functools
import re
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Final

from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import TransformException

from . import config_file, flag_table, limits
from .federation import settings as federation
from .process import sharing
from .ros2 import settings as ros2
from .security import settings as security
from .settings import DEFAULT_LISTEN, ServerSettings

_INTRODUCTION: Final = """\
# Server flags

`zenoh-tf-server --help` prints the same. Each flag may stand in the file of `--config` instead, by
its name without dashes (`cache-time = "30s"`); limits, access rules and limits of motion have
sections there ([security](../how-to/security.md),
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
        exit_on_error=False,
    )
    flags.add_argument("--version", action="version", version=f"%(prog)s {version('zenoh-tf')}")
    flags.add_argument(
        "--config",
        metavar="FILE",
        help="TOML file of flags and access rules; the command line wins (docs/how-to/security.md)",
    )
    flag_table.add(flags, ServerSettings)
    limits.add_flags(flags)
    security.add_flags(flags)
    return flags


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options of a command line and its configuration file. Exits with status 2 and a message
    if something is wrong."""
    flags = parser()
    try:
        options = config_file.parse_arguments(flags, arguments)
        complete(flags, options)
        options.security = security.from_flags(options, options.access)
    except (TransformException, argparse.ArgumentError) as error:
        flags.error(str(error))
    if options.security.authenticates and not options.connect:
        foreign = None
        found = settings(options)
        if found.ros2.enabled:
            foreign = "ROS 2 keys"
        elif found.ingest:
            foreign = "keys of other projects"
        elif found.federation.patterns:
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
    if options.listen and options.connect:
        flags.error("--listen and --connect exclude each other")
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
        for endpoint in getattr(options, flag):
            try:
                zenoh_config.check_endpoint(endpoint)
            except TransformException as error:
                flags.error(f"--{flag.replace('_', '-')}: {error}")
    options.listen = options.listen or [DEFAULT_LISTEN]


def _check_replica(flags: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if a flag contradicts --replica-of."""
    reasons = {
        "connect": "a replica listens for itself: leave --connect out",
        "state_dir": "a replica stores nothing: give --state-dir to the primary",
        "no_admin": "a replica accepts no writes: give --no-admin to the primary",
        "one_authority_per_frame": "a replica accepts no writes: give this flag to the primary",
        "ingest": "a replica accepts no writes: give --ingest to the primary",
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
    return flag_table.read(
        ServerSettings,
        options,
        limits=limits.read(options),
        security=options.security,
        motion_limits=options.motion_limits,
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
