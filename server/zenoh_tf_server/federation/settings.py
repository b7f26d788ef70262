"""The flags of a server that gathers the trees of robots."""

from __future__ import annotations

import argparse
import re
from collections import Counter
from dataclasses import dataclass
from typing import Final

from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import TransformException
from zenoh_tf.text import quoted
from zenoh_tf.text.flag_values import frames

_LINK: Final = re.compile(
    r"(?P<name>[^/:=,\x00-\x20\x7f]+)="
    r"(?P<endpoint>[a-z]+/(?:\[[^\]/]*\]|[^/:\[\]]+):[0-9]+)(?:/(?P<tree>.+?))?"
    r"(?:,max-frames=(?P<max_frames>[1-9][0-9]{0,8}))?"
)


@dataclass(frozen=True, slots=True)
class Link:
    """A robot's tree: ``NAME=ENDPOINT/TREE,max-frames=N``."""

    name: str  # also the prefix of its frames, and of its authorities
    endpoint: str
    tree: str
    max_frames: int | None = None  # that it may have here; None: an equal share


@dataclass(frozen=True)
class FederationSettings:
    """What the flags of `add_flags` say."""

    links: tuple[Link, ...] = ()
    shared: tuple[str, ...] = ()


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this module."""
    group = parser.add_argument_group("trees of robots (docs/how-to/federation.md)")
    group.add_argument(
        "--mirror-of",
        action="append",
        type=_link,
        default=[],
        metavar="LINK",
        help="ingest what is committed to a robot's tree as frames NAME/...: NAME=ENDPOINT/TREE or "
        "NAME=ENDPOINT, with ,max-frames=N for its share of the frames; repeatable",
    )
    group.add_argument(
        "--mirror-shared",
        type=frames,
        default=(),
        metavar="FRAMES",
        help="frames that get no prefix, as in map,world",
    )


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if the flags do not fit together."""
    if options.mirror_shared and not options.mirror_of:
        parser.error("--mirror-shared needs --mirror-of")
    if options.mirror_of and options.replica_of:
        parser.error(
            "--mirror-of and --replica-of exclude each other: a replica has its primary's tree"
        )
    for name, count in Counter(link.name for link in options.mirror_of).items():
        if count > 1:
            parser.error(f"--mirror-of: {count} robots are called {name!r}")


def from_flags(options: argparse.Namespace) -> FederationSettings:
    """The settings that the flags say."""
    return FederationSettings(tuple(options.mirror_of), tuple(options.mirror_shared))


def _link(text: str) -> Link:
    match = _LINK.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not NAME=PROTOCOL/HOST:PORT/TREE or ...,max-frames=N, as in "
            "robot1=tcp/10.0.0.1:7447/main; a name has no '/', ':', '=', ',' or space"
        )
    most = match["max_frames"]
    link = Link(
        match["name"], match["endpoint"], match["tree"] or "main", int(most) if most else None
    )
    try:
        zenoh_config.check_endpoint(link.endpoint)
        keys.server(link.tree, "")
    except TransformException as error:
        raise argparse.ArgumentTypeError(f"{quoted(text)}: {error}") from error
    return link
