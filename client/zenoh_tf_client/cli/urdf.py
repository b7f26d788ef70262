"""``zenoh-tf urdf``: the transforms of a robot that a URDF file describes."""

from __future__ import annotations

import argparse
from pathlib import Path

from zenoh_tf.text import printable
from zenoh_tf_client.cli import output
from zenoh_tf_client.cli.connection import connect
from zenoh_tf_client.cli.errors import CommandError
from zenoh_tf_client.cli.types import Commands
from zenoh_tf_client.urdf.kinematics import FrameNames, fixed_transforms
from zenoh_tf_client.urdf.reader import MOVING, UNSUPPORTED, Joint, Robot, read

_DESCRIPTION = """\
Store the fixed joints of a URDF file as static links, all in one transaction.
Floating and planar joints are named and left out.
"""
_EPILOG = """\
examples:
  zenoh-tf urdf robot.urdf --print
  zenoh-tf urdf robot.urdf --prefix robot1 --shared map,world
"""


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    urdf = commands.add_parser(
        "urdf",
        parents=[common],
        help="store the links of a robot that a URDF file describes",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
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
        "--authority", metavar="NAME", default="urdf", help="name to publish as (default urdf)"
    )
    urdf.set_defaults(run=_urdf)


def _urdf(args: argparse.Namespace) -> int:
    try:
        robot = read(args.file)
    except OSError as error:
        raise CommandError(f"{args.file}: {error.strerror or error}") from error
    frame = FrameNames(args.prefix, filter(None, args.shared.split(",")))
    if args.only_print:
        _print(args, robot, frame, stored=False)
        return 0
    static = fixed_transforms(robot, frame)
    with connect(args) as tf:
        if static:
            tf.set_transforms_xact(static, authority=args.authority, static=True)
    _print(args, robot, frame, stored=True)
    return 0


def _print(args: argparse.Namespace, robot: Robot, frame: FrameNames, *, stored: bool) -> None:
    if args.json:
        output.print_json(
            {
                "robot": robot.name,
                "root": frame(robot.root),
                "stored": stored,
                "joints": [_document(joint, frame) for joint in robot.joints],
            }
        )
        return
    if not stored:
        for joint in robot.joints:
            print(_line(joint, frame))
    fixed, moving = robot.of_kind("fixed"), robot.of_kind(*MOVING)
    name = printable(robot.name or str(args.file))
    done = "stored as static" if stored else "fixed"
    print(f"{name}: {_count(fixed, 'joint')} {done}, root frame {printable(frame(robot.root))}")
    if moving:
        print(f"{_count(moving, 'joint')} that move: {_names(moving)}")
    for joint in robot.of_kind(*UNSUPPORTED):
        parent, child = printable(frame(joint.parent)), printable(frame(joint.child))
        print(
            f"left out: joint {printable(joint.name)} is {joint.kind}; publish {parent} -> {child} "
            "yourself"
        )


def _line(joint: Joint, frame: FrameNames) -> str:
    ends = f"{printable(frame(joint.parent))} -> {printable(frame(joint.child))}"
    line = f"{output.paint('frame', ends)}  {joint.kind} joint {printable(joint.name)}"
    if joint.mimic is not None:
        line += f", mimics {printable(joint.mimic.joint)}"
    x, y, z, *rotation = joint.origin.pose()
    xyz, xyzw = output.numbers("xyz", (x, y, z)), output.numbers("xyzw", rotation)
    return f"{line}\n{output.row('translation', xyz + '  m')}\n{output.row('rotation', xyzw)}"


def _document(joint: Joint, frame: FrameNames) -> dict[str, object]:
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
