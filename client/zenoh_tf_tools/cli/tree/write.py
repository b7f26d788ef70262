"""``zenoh-tf set``, ``remove``, ``clear`` and ``reset``: change the tree."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Final

from zenoh_tf import StampedTransform, Transform
from zenoh_tf.text import printable
from zenoh_tf.text.flag_values import angle, number
from zenoh_tf.text.time_flags import LIVE_TIMES, live_time
from zenoh_tf.text.times import seconds
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_authority
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.errors import CommandError

#: The authority of what people set by hand.
AUTHORITY: Final = "zenoh-tf"
_ANGLES: Final = ("roll", "pitch", "yaw")


def add(commands: Commands) -> None:
    _add_set(commands)
    remove = commands.add(
        "remove",
        _remove,
        "forget a frame: its link, its history and its name",
        "Forget a frame: its link, its history and its name. Fails if other frames are below it, "
        "unless --subtree is given.",
        "zenoh-tf remove cup",
        "zenoh-tf remove base_link --subtree",
    )
    remove.add_argument("frame", metavar="FRAME")
    remove.add_argument(
        "--subtree", action="store_true", help="also forget all frames below it, atomically"
    )

    clear = commands.add(
        "clear",
        _clear,
        "forget what was published; static links stay",
        "Forget every sample. Static links stay, unless --all is given.",
        "zenoh-tf clear",
        "zenoh-tf clear --all",
    )
    clear.add_argument(
        "--all", dest="keep_static", action="store_false", help="forget static links as well"
    )

    reset = commands.add(
        "reset",
        _reset,
        "forget everything, frame names included; needs --yes",
        "Forget every frame at one instant: all samples, static links and names. Nothing is asked; "
        "without --yes nothing is done.",
        "zenoh-tf reset --yes",
    )
    reset.add_argument("--yes", action="store_true", help="confirm that everything is to go")


def _add_set(commands: Commands) -> None:
    set_ = commands.add(
        "set",
        _set,
        "store the pose of CHILD in PARENT",
        "Store the pose of CHILD in PARENT: metres, and a quaternion, or angles about the fixed "
        "axes x, y and z (none: identity). Waits until the server has it.",
        "zenoh-tf set map table 2 0.5 0.7",
        "zenoh-tf set map table 2 0.5 0.7 --yaw 90deg",
        "zenoh-tf set map cup 2 0.5 0.8 0 0 0.7071 0.7071 --stamp now",
    )
    # argparse itself would name the pose twice.
    set_.usage = "zenoh-tf set [options] PARENT CHILD X Y Z [QX QY QZ QW]"
    set_.add_argument("parent", metavar="PARENT")
    set_.add_argument("child", metavar="CHILD")
    set_.add_argument(
        "pose", metavar="X Y Z [QX QY QZ QW]", nargs="+", type=number(), help="3 or 7 numbers"
    )
    for name in _ANGLES:
        set_.add_argument(
            f"--{name}", metavar="ANGLE", type=angle(), help=f"{name}, as in 90deg or 1.57rad"
        )
    set_.add_argument("--static", action="store_true", help="the pose holds at all times")
    set_.add_argument("--stamp", metavar="TIME", type=live_time, help=f"{LIVE_TIMES} (default now)")
    add_authority(set_, AUTHORITY)


def _set(args: argparse.Namespace) -> int:
    if len(args.pose) not in (3, 7):
        args.usage_error(f"a pose is 3 or 7 numbers, not {len(args.pose)}")
    stamp_ns = time.time_ns() if args.stamp is None else args.stamp
    pose = pose_of(args, args.pose[:3], args.pose[3:] or None)
    return store(
        args, StampedTransform(args.parent, args.child, stamp_ns, pose), static=args.static
    )


def pose_of(
    args: argparse.Namespace, position: Sequence[float], quaternion: Sequence[float] | None
) -> Transform:
    """The pose at a position, turned by a quaternion or else by the angles that are given."""
    angles = [getattr(args, name) for name in _ANGLES]
    if quaternion is not None:
        if any(each is not None for each in angles):
            args.usage_error("give angles or a quaternion, not both")
        return Transform(position, quaternion)
    roll, pitch, yaw = (each or 0.0 for each in angles)
    return Transform.from_rpy(roll, pitch, yaw, translation=position)


def store(args: argparse.Namespace, stamped: StampedTransform, *, static: bool) -> int:
    """Store one transform, and print that it is. Returns the exit code."""
    parent, child, stamp_ns = stamped.parent_frame, stamped.child_frame, stamped.stamp_ns
    with connect(args) as tf:
        stored = tf.set_transform(stamped, authority=args.authority, static=static)
    if not stored:
        raise CommandError(
            f"dropped: {seconds(stamp_ns)} s is older than the server's cache time "
            f"allows for {child!r}"
        )
    facts = {"parent": parent, "child": child, "stamp_ns": stamp_ns, "static": static}
    kind = "static" if static else f"at {seconds(stamp_ns)} s"
    text = f"{printable(parent)} -> {printable(child)} stored, {kind}"
    output.show(args, facts | {"stored": True}, text)
    return 0


def _remove(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        tf.remove_frame(args.frame, args.subtree)
    below = " and all frames below it" if args.subtree else ""
    document = {"removed": args.frame, "subtree": args.subtree}
    output.show(args, document, f"{printable(args.frame)}{below} removed")
    return 0


def _clear(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        tf.clear(args.keep_static)
    rest = "; static links stay" if args.keep_static else ""
    document = {"cleared": True, "kept_static": args.keep_static}
    output.show(args, document, f"tree {args.tree!r} cleared{rest}")
    return 0


def _reset(args: argparse.Namespace) -> int:
    if not args.yes:
        args.usage_error(f"reset forgets every frame of tree {args.tree!r}; confirm with --yes")
    with connect(args) as tf:
        tf.reset()
    text = f"tree {args.tree!r} reset: all samples, static links and names are gone"
    output.show(args, {"reset": True}, text)
    return 0
