"""``zenoh-tf urdf``: the transforms of a robot that a URDF file describes."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Final, NoReturn

from zenoh_tf.text import printable, quoted
from zenoh_tf.text.flag_values import whole
from zenoh_tf.urdf.kinematics import FrameNames, JointTransforms, fixed_transforms
from zenoh_tf.urdf.reader import MOVING, UNSUPPORTED, Joint, Robot, read
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.joint_states import JointStateFeed

_PERIOD_S: Final = 0.5
#: After this long without a message it is reported.
_SILENCE_S: Final = 5.0
#: Warnings about a file that are printed; ``--json`` has all.
_MAX_WARNINGS: Final = 10


def add(commands: Commands) -> None:
    urdf = commands.add(
        "urdf",
        _urdf,
        "store the links of a robot that a URDF file describes",
        "Store the fixed joints of a URDF file as static links, all in one transaction. Floating "
        "and planar joints are named and left out.\n\n"
        "With --joint-states it also listens to the robot until it is interrupted, and publishes "
        "the joints that move, with those that mimic them.",
        "zenoh-tf urdf robot.urdf --print",
        "zenoh-tf urdf robot.urdf --prefix robot1 --shared map,world",
        "zenoh-tf urdf robot.urdf --joint-states",
        "zenoh-tf urdf robot.urdf --joint-states /robot1/joint_states --prefix robot1",
    )
    urdf.add_argument("file", metavar="FILE", type=Path, help="URDF; expand xacro first")
    urdf.add_argument(
        "--print",
        dest="only_print",
        action="store_true",
        help="print the joints; ask no server and store nothing",
    )
    urdf.add_argument(
        "--prefix", metavar="NAME", default="", help="name the frames NAME/LINK (default: LINK)"
    )
    urdf.add_argument(
        "--shared",
        metavar="LINK,...",
        default="",
        help="links that get no prefix, as several robots have them",
    )
    urdf.add_argument(
        "--authority",
        metavar="NAME",
        help="name to publish as (default urdf, with a prefix urdf/PREFIX)",
    )
    urdf.add_argument(
        "--joint-states",
        metavar="TOPIC",
        nargs="?",
        const="/joint_states",
        help="listen to this ROS 2 topic on the server's Zenoh network (default /joint_states) "
        "and publish the joints that move",
    )
    urdf.add_argument(
        "--domain",
        metavar="N",
        type=whole(0, 232),
        help="with --joint-states: only of this ROS 2 domain (default: any)",
    )


def _urdf(args: argparse.Namespace) -> int:
    if args.only_print and args.joint_states is not None:
        args.usage_error("--print asks no server, so it does not go with --joint-states")
    try:
        robot = read(args.file)
    except OSError as error:
        raise CommandError(f"{args.file}: {error.strerror or error}") from error
    for warning in robot.warnings[:_MAX_WARNINGS]:
        print(f"zenoh-tf: {printable(warning)}", file=sys.stderr)
    if (more := len(robot.warnings) - _MAX_WARNINGS) > 0:
        print(f"zenoh-tf: and {more:,} more joints like these", file=sys.stderr)
    if args.authority is None:
        args.authority = "/".join(filter(None, ("urdf", args.prefix.strip("/"))))
    frame = FrameNames(args.prefix, filter(None, args.shared.split(",")))
    if args.only_print:
        _print(args, robot, frame, stored=False)
        return 0
    static = fixed_transforms(robot, frame)
    with connect(args) as tf:
        if static:
            tf.set_transforms_xact(static, authority=args.authority, static=True)
        if args.joint_states is None:
            _print(args, robot, frame, stored=True)
        else:
            # A server that is restarted gets the fixed joints again.
            tf.broadcaster(args.authority).send_static(static)
            _follow(args, tf, robot, frame)
    return 0


def _follow(args: argparse.Namespace, tf: TransformClient, robot: Robot, frame: FrameNames) -> None:
    """Publish the joints of a robot until Ctrl-C, then print the counts."""
    joints = JointTransforms(robot, frame)
    feed = JointStateFeed(tf, joints, args.authority, args.joint_states, args.domain)
    if not args.json:
        _print(args, robot, frame, stored=True)
        sys.stdout.flush()
    try:
        _listen(feed, joints)
    finally:
        feed.close()
        counts = _counts(feed, joints)
        if args.json:
            disputed = {joint: list(senders) for joint, senders in feed.disputed.items()}
            output.print_json(
                _document(robot, frame, stored=True) | {"counts": counts, "disputed": disputed}
            )
        else:
            print(", ".join(f"{name} {count:,}" for name, count in counts.items() if count))
        sys.stdout.flush()


def _listen(feed: JointStateFeed, joints: JointTransforms) -> NoReturn:
    """Wait for Ctrl-C, which raises KeyboardInterrupt. Meanwhile each kind of problem is one line
    on stderr, when it first occurs."""
    print(f"listening to {printable(feed.topic)}; Ctrl-C ends it", file=sys.stderr, flush=True)
    reported: set[str] = set()
    silent_at_s = time.monotonic() + _SILENCE_S
    while True:
        for kind, text in _problems(feed, joints, time.monotonic() > silent_at_s):
            if kind not in reported:
                reported.add(kind)
                print(f"zenoh-tf: {printable(text)}", file=sys.stderr, flush=True)
        time.sleep(_PERIOD_S)


def _counts(feed: JointStateFeed, joints: JointTransforms) -> dict[str, int]:
    """What became of the messages and of the positions in them."""
    return asdict(feed.counts) | asdict(joints.counts)


def _problems(
    feed: JointStateFeed, joints: JointTransforms, is_late: bool
) -> Iterator[tuple[str, str]]:
    """(kind, text) of what is wrong by now."""
    found = _counts(feed, joints)
    if not found["messages"] and feed.other_topic:
        yield "other", f"no message on {feed.topic}, but on {feed.other_topic}: name that topic"
    elif not found["messages"] and is_late:
        yield (
            "silence",
            f"no message on {feed.topic} so far: is the robot on the server's Zenoh network?",
        )
    if disputed := dict(feed.disputed):
        joint, (one, other) = next(iter(disputed.items()))
        more = f" and {len(disputed) - 1:,} more" if len(disputed) > 1 else ""
        yield (
            "disputed_joints",
            f"two nodes send joint {quoted(joint)}{more}: {one} and {other}; the robot jumps "
            "between their positions until one of them ends or sends other joints",
        )
    for kind, text in (
        ("malformed", f"malformed messages are dropped: {feed.last_error}"),
        ("no_positions", "messages without positions are dropped"),
        ("no_stamp", "messages without a time (stamp 0) are dropped"),
        ("not_sent", f"messages are dropped: {feed.last_error}"),
        ("unknown_joints", "joints that the file has not are left out, such as"),
        ("not_numbers", "positions that are NaN or infinite are not used, such as that of"),
        (
            "beyond_limits",
            "positions beyond the limits are published all the same, such as that of",
        ),
    ):
        if found[kind]:
            first = joints.first.get(kind)
            yield kind, text if first is None else f"{text} {quoted(first)}"


def _print(args: argparse.Namespace, robot: Robot, frame: FrameNames, *, stored: bool) -> None:
    if args.json:
        output.print_json(_document(robot, frame, stored=stored))
        return
    if not stored:
        for joint in robot.joints:
            print(_line(joint, frame))
    fixed, moving = robot.of_kind("fixed"), robot.of_kind(*MOVING)
    name = printable(robot.name or str(args.file))
    done = "stored as static" if stored else "fixed"
    print(f"{name}: {_count(fixed, 'joint')} {done}, root frame {printable(frame(robot.root))}")
    if moving:
        how = "" if args.joint_states is not None else " with --joint-states"
        verb = "moves" if len(moving) == 1 else "move"
        print(f"{_count(moving, 'joint')} that {verb}{how}: {_names(moving)}")
    for joint in robot.of_kind(*UNSUPPORTED):
        parent, child = printable(frame(joint.parent)), printable(frame(joint.child))
        print(
            f"left out: joint {printable(joint.name)} is {joint.kind}; publish {parent} -> {child} "
            "yourself"
        )


def _document(robot: Robot, frame: FrameNames, *, stored: bool) -> dict[str, object]:
    return {
        "robot": robot.name,
        "root": frame(robot.root),
        "stored": stored,
        "warnings": list(robot.warnings),
        "joints": [_joint_document(joint, frame) for joint in robot.joints],
    }


def _line(joint: Joint, frame: FrameNames) -> str:
    ends = f"{printable(frame(joint.parent))} -> {printable(frame(joint.child))}"
    line = f"{output.paint('frame', ends)}  {joint.kind} joint {printable(joint.name)}"
    if joint.mimic is not None:
        line += f", mimics {printable(joint.mimic.joint)}"
    x, y, z, *rotation = joint.origin.pose()
    xyz, xyzw = output.numbers("xyz", (x, y, z)), output.numbers("xyzw", rotation)
    return f"{line}\n{output.row('translation', xyz + '  m')}\n{output.row('rotation', xyzw)}"


def _joint_document(joint: Joint, frame: FrameNames) -> dict[str, object]:
    document: dict[str, object] = {
        "joint": joint.name,
        "type": joint.kind,
        "parent": frame(joint.parent),
        "child": frame(joint.child),
        "translation": joint.origin.translation.tolist(),
        "rotation": joint.origin.rotation.tolist(),
    }
    if joint.kind in MOVING:
        document["axis"] = joint.axis.tolist()
    if joint.mimic is not None:
        document["mimics"] = joint.mimic.joint
    return document


def _count(joints: list[Joint], noun: str) -> str:
    return f"{len(joints):,} {noun}{'' if len(joints) == 1 else 's'}"


def _names(joints: list[Joint]) -> str:
    return ", ".join(printable(joint.name) for joint in joints)
