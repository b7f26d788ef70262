"""The flags of ROS 2 in and out."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Final

from zenoh_tf.text.flag_values import frames, number, whole
from zenoh_tf.text.time_flags import duration

from ..flag_table import flag
from ..ingest.prefixes import PrefixRule, parse_rule

_GROUP: Final = "ROS 2: robots with rmw_zenoh or zenoh-bridge-ros2dds (docs/how-to/ros2.md)"
#: Zenoh is not bound by it, but ROS 2 nodes are.
_HIGHEST_DOMAIN: Final = 232


@dataclass(frozen=True)
class Ros2Settings:
    """What the flags of ROS 2 say."""

    receive: bool = flag(
        "--ros2", False, "ingest the transforms of /tf and /tf_static", group=_GROUP
    )
    rules: tuple[PrefixRule, ...] = flag(
        "--ros2-prefix",
        (),
        "prefix each robot's frames by its namespace, domain or session, or one's, as in "
        "namespace:robot1=r1; repeatable",
        group=_GROUP,
        action="append",
        type=parse_rule,
        metavar="RULE",
    )
    shared: tuple[str, ...] = flag(
        "--ros2-shared",
        (),
        "frames that get no prefix, as in map,world,earth",
        group=_GROUP,
        type=frames,
        metavar="FRAMES",
    )
    static_grace_s: float = flag(
        "--ros2-static-grace",
        30.0,
        "forget static transforms so long after their publisher is gone; 0: never "
        "(default: %(default)gs)",
        group=_GROUP,
        type=duration(),
        metavar="DURATION",
    )
    publish: tuple[str, ...] = flag(  # patterns of child frames; empty: nothing is published
        "--ros2-publish",
        (),
        "publish what others commit: all, or child frames as in 'camera*'; repeatable",
        group=_GROUP,
        action="append",
        nargs="?",
        const="*",
        metavar="FRAMES",
    )
    rate_hz: float = flag(
        "--ros2-publish-rate",
        50.0,
        "of each frame's newest transform, at most (default: %(default)g)",
        group=_GROUP,
        type=number(0.1, 1000.0),
        metavar="HZ",
    )
    domain: int = flag(
        "--ros2-domain",
        0,
        "domain to publish in (default: %(default)s)",
        group=_GROUP,
        type=whole(0, _HIGHEST_DOMAIN),
        metavar="N",
    )

    @property
    def enabled(self) -> bool:
        """True if the server joins a ROS 2 network."""
        return self.receive or bool(self.publish)


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if the flags do not fit together."""
    for given, name in ((options.ros2_prefix, "prefix"), (options.ros2_shared, "shared")):
        if given and not options.ros2:
            parser.error(f"--ros2-{name} needs --ros2")
    if options.ros2_shared and not options.ros2_prefix:
        parser.error("--ros2-shared needs --ros2-prefix: without prefixes, all frames are shared")
