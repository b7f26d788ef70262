"""``zenoh-tf set``, ``remove``, ``clear`` and ``reset``: change the tree."""

from __future__ import annotations

import argparse
import time
from typing import Final

from zenoh_tf import StampedTransform, Transform
from zenoh_tf.text import printable
from zenoh_tf.text.flag_values import LIVE_TIMES, live_time, number
from zenoh_tf.text.times import seconds
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.types import Commands, examples
from zenoh_tf_tools.errors import CommandError

#: The authority of what people set by hand.
AUTHORITY: Final = "zenoh-tf"


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    set_ = commands.add_parser(
        "set",
        parents=[common],
        help="store the pose of CHILD in PARENT",
        # argparse itself would name the pose twice.
        usage="zenoh-tf set [options] PARENT CHILD X Y Z [QX QY QZ QW]",
        description="Store the pose of CHILD in PARENT: metres, and a quaternion (identity if "
        "left out). Waits until the server has it.",
        **examples(
            "zenoh-tf set map table 2 0.5 0.7",
            "zenoh-tf set map cup 2 0.5 0.8 0 0 0.7071 0.7071 --stamp now",
        ),
    )
    set_.add_argument("parent", metavar="PARENT")
    set_.add_argument("child", metavar="CHILD")
    set_.add_argument(
        "pose", metavar="X Y Z [QX QY QZ QW]", nargs="+", type=number(), help="3 or 7 numbers"
    )
    set_.add_argument("--static", action="store_true", help="the pose holds at all times")
    set_.add_argument(
        "--stamp",
        metavar="TIME",
        type=live_time,
        help=f"{LIVE_TIMES} (default now)",
    )
    set_.add_argument(
        "--authority",
        metavar="NAME",
        default=AUTHORITY,
        help=f"name to publish as (default {AUTHORITY})",
    )
    set_.set_defaults(run=_set, usage_error=set_.error)

    remove = commands.add_parser(
        "remove",
        parents=[common],
        help="forget a frame: its link, its history and its name",
        description="Forget a frame: its link, its history and its name. Fails if other frames are "
        "below it, unless --subtree is given.",
        **examples("zenoh-tf remove cup", "zenoh-tf remove base_link --subtree"),
    )
    remove.add_argument("frame", metavar="FRAME")
    remove.add_argument(
        "--subtree", action="store_true", help="also forget all frames below it, atomically"
    )
    remove.set_defaults(run=_remove)

    clear = commands.add_parser(
        "clear",
        parents=[common],
        help="forget what was published; static links stay",
        description="Forget every sample. Static links stay, unless told otherwise.",
        **examples("zenoh-tf clear", "zenoh-tf clear --all"),
    )
    clear.add_argument(
        "--all", dest="keep_static", action="store_false", help="forget static links as well"
    )
    clear.set_defaults(run=_clear)

    reset = commands.add_parser(
        "reset",
        parents=[common],
        help="forget everything, frame names included; needs --yes",
        description="Forget every frame at one instant: all samples, static links and names. "
        "Nothing is asked; without --yes nothing is done.",
        **examples("zenoh-tf reset --yes"),
    )
    reset.add_argument("--yes", action="store_true", help="confirm that everything is to go")
    reset.set_defaults(run=_reset, usage_error=reset.error)


def _set(args: argparse.Namespace) -> int:
    if len(args.pose) not in (3, 7):
        args.usage_error(f"a pose is 3 or 7 numbers, not {len(args.pose)}")
    stamp_ns = time.time_ns() if args.stamp is None else args.stamp
    rotation = args.pose[3:] or (0.0, 0.0, 0.0, 1.0)
    stamped = StampedTransform(
        args.parent, args.child, stamp_ns, Transform(args.pose[:3], rotation)
    )
    return store(args, stamped, static=args.static)


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
    if args.json:
        output.print_json(
            {
                "parent": parent,
                "child": child,
                "stamp_ns": stamp_ns,
                "static": static,
                "stored": True,
            }
        )
    else:
        kind = "static" if static else f"at {seconds(stamp_ns)} s"
        print(f"{printable(parent)} -> {printable(child)} stored, {kind}")
    return 0


def _remove(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        tf.remove_frame(args.frame, args.subtree)
    if args.json:
        output.print_json({"removed": args.frame, "subtree": args.subtree})
    else:
        below = " and all frames below it" if args.subtree else ""
        print(f"{printable(args.frame)}{below} removed")
    return 0


def _clear(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        tf.clear(args.keep_static)
    if args.json:
        output.print_json({"cleared": True, "kept_static": args.keep_static})
    else:
        rest = "; static links stay" if args.keep_static else ""
        print(f"tree {args.tree!r} cleared{rest}")
    return 0


def _reset(args: argparse.Namespace) -> int:
    if not args.yes:
        args.usage_error(f"reset forgets every frame of tree {args.tree!r}; confirm with --yes")
    with connect(args) as tf:
        tf.reset()
    if args.json:
        output.print_json({"reset": True})
    else:
        print(f"tree {args.tree!r} reset: all samples, static links and names are gone")
    return 0
