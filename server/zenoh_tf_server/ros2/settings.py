"""The flags of ROS 2 in and out."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from zenoh_tf.text.flag_values import frames, number, whole
from zenoh_tf.text.time_flags import duration

from ..ingest.prefixes import PrefixRule, parse_rule

DEFAULT_GRACE_S = 30.0
DEFAULT_RATE_HZ = 50.0
#: Zenoh is not bound by it, but ROS 2 nodes are.
_HIGHEST_DOMAIN = 232


@dataclass(frozen=True)
class Ros2Settings:
    """What the flags of `add_flags` say."""

    receive: bool = False
    rules: tuple[PrefixRule, ...] = ()
    shared: tuple[str, ...] = ()
    static_grace_s: float = DEFAULT_GRACE_S  # 0: static links stay for good
    publish: tuple[str, ...] = ()  # patterns of child frames; empty: nothing is published
    rate_hz: float = DEFAULT_RATE_HZ
    domain: int = 0

    @property
    def enabled(self) -> bool:
        """True if the server joins a ROS 2 network."""
        return self.receive or bool(self.publish)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of ROS 2."""
    group = parser.add_argument_group(
        "ROS 2: robots with rmw_zenoh or zenoh-bridge-ros2dds (docs/how-to/ros2.md)"
    )
    group.add_argument(
        "--ros2",
        action="store_true",
        help="ingest the transforms of /tf and /tf_static",
    )
    group.add_argument(
        "--ros2-prefix",
        action="append",
        type=parse_rule,
        default=[],
        metavar="RULE",
        help="prefix each robot's frames by its namespace, domain or session, or one's, as in "
        "namespace:robot1=r1; repeatable",
    )
    group.add_argument(
        "--ros2-shared",
        type=frames,
        default=(),
        metavar="FRAMES",
        help="frames that get no prefix, as in map,world,earth",
    )
    group.add_argument(
        "--ros2-static-grace",
        type=duration(),
        default=DEFAULT_GRACE_S,
        metavar="DURATION",
        help="forget static transforms so long after their publisher is gone; 0: never "
        "(default: %(default)gs)",
    )
    group.add_argument(
        "--ros2-publish",
        action="append",
        nargs="?",
        const="*",
        default=[],
        metavar="FRAMES",
        help="publish what others commit: all, or child frames as in 'camera*'; repeatable",
    )
    group.add_argument(
        "--ros2-publish-rate",
        type=number(0.1, 1000.0),
        default=DEFAULT_RATE_HZ,
        metavar="HZ",
        help="of each frame's newest transform, at most (default: %(default)g)",
    )
    group.add_argument(
        "--ros2-domain",
        type=whole(0, _HIGHEST_DOMAIN),
        default=0,
        metavar="N",
        help="domain to publish in (default: %(default)s)",
    )


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if the flags do not fit together."""
    for given, flag in ((options.ros2_prefix, "prefix"), (options.ros2_shared, "shared")):
        if given and not options.ros2:
            parser.error(f"--ros2-{flag} needs --ros2")
    if options.ros2_shared and not options.ros2_prefix:
        parser.error("--ros2-shared needs --ros2-prefix: without prefixes, all frames are shared")


def from_flags(options: argparse.Namespace) -> Ros2Settings:
    """The settings that the flags say."""
    return Ros2Settings(
        receive=options.ros2,
        rules=tuple(options.ros2_prefix),
        shared=tuple(options.ros2_shared),
        static_grace_s=options.ros2_static_grace,
        publish=tuple(options.ros2_publish),
        rate_hz=options.ros2_publish_rate,
        domain=options.ros2_domain,
    )
