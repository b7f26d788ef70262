"""The flags of a server that gathers the trees of robots."""

from __future__ import annotations

import argparse
import re
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import TransformException
from zenoh_tf.mirrors.interest import HIGHEST_HZ, LOWEST_HZ, interest_of
from zenoh_tf.text import quoted
from zenoh_tf.text.flag_values import frames, number, whole

from .. import flag_table
from ..flag_table import flag

_GROUP: Final = "trees of robots (docs/how-to/federation.md)"
#: Also where a tree is named, a comma begins an option.
_LINK: Final = re.compile(
    r"(?P<name>[^/:=,\x00-\x20\x7f]+)="
    r"(?P<endpoint>[a-z]+/(?:\[[^\]/]*\]|[^/:\[\]]+):[0-9]+)(?:/(?P<tree>[^,]+))?"
    r"(?P<options>(?:,[^,=]+=[^,]*)*)"
)
#: What a robot may be called.
_NAME: Final = re.compile(r"[^/:=,\x00-\x20\x7f]+")
_PATTERN: Final = re.compile(
    r"(?P<before>[^*=,]*)\*(?P<after>[^*=,]*)(?P<options>(?:,[^,=]+=[^,]*)*)"
)
#: A ':' alone, without a '\' before it: names may have '::', as those of Gazebo.
_BETWEEN_FRAMES: Final = re.compile(r"(?<![:\\]):(?!:)")
#: A robot has at most so many frames.
_MAX_FRAMES: Final = 10**9 - 1


@dataclass(frozen=True, slots=True)
class Share:
    """What a robot's tree may be here, and what of it is taken: ``max-frames=N,frames=A:B,rate=HZ``
    behind a comma."""

    max_frames: int | None = None  # that it may have here; None: an equal share
    interest: wire.Interest | None = None  # which of its frames, and how often; None: everything


@dataclass(frozen=True, slots=True)
class RobotAddress:
    """A robot's tree: ``NAME=ENDPOINT/TREE``, and its share."""

    name: str  # also the prefix of its frames, and of its authorities
    endpoint: str
    tree: str
    share: Share = Share()


@dataclass(frozen=True, slots=True)
class RobotPattern:
    """The trees of robots that are found on the server's own network: ``robots/*``."""

    before: str
    after: str
    share: Share = Share()

    def robot_of(self, tree: str) -> str | None:
        """The name of the robot that has a tree, which is what the ``*`` stands for; None if the
        tree does not match, or no robot may be called so."""
        if not (tree.startswith(self.before) and tree.endswith(self.after)):
            return None
        name = tree[len(self.before) : len(tree) - len(self.after)]
        return name if _NAME.fullmatch(name) else None


def _robot(text: str) -> RobotAddress | RobotPattern:
    pattern, match = _PATTERN.fullmatch(text), _LINK.fullmatch(text)
    if pattern is None and match is None:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not NAME=PROTOCOL/HOST:PORT/TREE, or a pattern of trees such as "
            "'robots/*', with options ...,OPTION=VALUE, as in "
            "robot1=tcp/10.0.0.1:7447/main,frames=map:base_link,rate=10; a name has no '/', ':', "
            "'=', ',' or space"
        )
    try:
        if match is None:
            assert pattern is not None
            return RobotPattern(pattern["before"], pattern["after"], _share(pattern["options"]))
        link = RobotAddress(
            match["name"], match["endpoint"], match["tree"] or "main", _share(match["options"])
        )
        zenoh_config.check_endpoint(link.endpoint)
        keys.server(link.tree, "")
    except (TransformException, argparse.ArgumentTypeError) as error:
        raise argparse.ArgumentTypeError(f"{quoted(text)}: {error}") from error
    return link


def _share(options: str) -> Share:
    """The share that options say, each behind a comma. Raises ArgumentTypeError."""
    parsers = {
        "frames": _path_ends,
        "rate": number(LOWEST_HZ, HIGHEST_HZ),
        "max-frames": whole(1, _MAX_FRAMES),
    }
    values: dict[str, Any] = {}
    for option in options.split(",")[1:]:
        field, _, value = option.partition("=")
        if field not in parsers:
            raise argparse.ArgumentTypeError(
                f"unknown option {quoted(field)}: use {', '.join(parsers)}"
            )
        if field in values:
            raise argparse.ArgumentTypeError(f"{field} is given twice")
        try:
            values[field] = parsers[field](value)
        except argparse.ArgumentTypeError as error:
            raise argparse.ArgumentTypeError(f"{field}: {error}") from error
    interest = interest_of(values.get("frames"), None, values.get("rate"))
    return Share(values.get("max-frames"), interest)


def _path_ends(text: str) -> list[tuple[str, str]]:
    """The pairs of neighbours in a list of frames, whose paths join all of them."""
    names = [name.replace("\\:", ":") for name in _BETWEEN_FRAMES.split(text)]
    if len(names) < 2 or not all(names):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a list of two or more frames, as in map:base_link; '::' is "
            "part of a name, and a single ':' in a name is written '\\:'"
        )
    return list(pairwise(names))


@dataclass(frozen=True)
class FederationSettings:
    """What the flags of this module say."""

    robots: tuple[RobotAddress | RobotPattern, ...] = flag(
        "--mirror-of",
        (),
        "ingest a robot's tree as frames NAME/...: NAME=ENDPOINT/TREE, or 'robots/*': all "
        "such trees on this network; ,frames=map:base_link: only their paths; ,rate=10: their "
        "newest samples at 10 Hz; ,max-frames=N: its share; repeatable",
        group=_GROUP,
        action="append",
        type=_robot,
        metavar="ROBOT",
    )
    shared: tuple[str, ...] = flag(
        "--mirror-shared",
        (),
        "frames that get no prefix, as in map,world",
        group=_GROUP,
        type=frames,
        metavar="FRAMES",
    )

    @property
    def links(self) -> list[RobotAddress]:
        """The robots that are listed."""
        return [robot for robot in self.robots if isinstance(robot, RobotAddress)]

    @property
    def patterns(self) -> list[RobotPattern]:
        """The trees of robots that are searched for."""
        return [robot for robot in self.robots if isinstance(robot, RobotPattern)]


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if the flags do not fit together."""
    if options.mirror_shared and not options.mirror_of:
        parser.error("--mirror-shared needs --mirror-of")
    if options.mirror_of and options.replica_of:
        parser.error(
            "--mirror-of and --replica-of exclude each other: a replica has its primary's tree"
        )
    links = flag_table.read(FederationSettings, options).links
    for name, count in Counter(link.name for link in links).items():
        if count > 1:
            parser.error(f"--mirror-of: {count} robots are called {name!r}")
