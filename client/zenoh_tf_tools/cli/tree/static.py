"""``zenoh-tf static``: store a static link, with the arguments of tf2's publisher."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Final, NoReturn

from zenoh_tf import StampedTransform, Transform
from zenoh_tf.text.flag_values import number
from zenoh_tf_tools.cli.tree.write import AUTHORITY, store
from zenoh_tf_tools.cli.types import Commands, examples

_USAGE: Final = """\
zenoh-tf static [options] X Y Z YAW PITCH ROLL PARENT CHILD
       zenoh-tf static [options] X Y Z QX QY QZ QW PARENT CHILD
       zenoh-tf static [options] [--x X] [--y Y] [--z Z]
                       [--roll R] [--pitch P] [--yaw Y] | [--qx X --qy Y --qz Z --qw W]
                       --frame-id PARENT --child-frame-id CHILD"""
_POSITION: Final = ("x", "y", "z")
_ANGLES: Final = ("roll", "pitch", "yaw")
_QUATERNION: Final = ("qx", "qy", "qz", "qw")


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    static = commands.add_parser(
        "static",
        parents=[common],
        help="store a static link, with tf2's argument forms",
        usage=_USAGE,
        description="Store the pose of CHILD in PARENT for all times: metres, and radians or a "
        "quaternion. The arguments are those of tf2's static_transform_publisher. The server "
        "keeps the link, so the command ends.",
        **examples(
            "zenoh-tf static 0.1 0 0.25 0 0 0 base_link camera",
            "zenoh-tf static 0.1 0 0.25 0 0 0 1 base_link camera",
            "zenoh-tf static --x 0.1 --yaw 1.5708 --frame-id base_link --child-frame-id camera",
        ),
    )
    static.add_argument("words", metavar="ARG", nargs="*", help="one of the two forms in a row")
    for name in (*_POSITION, *_ANGLES, *_QUATERNION):
        unit = "m" if name in _POSITION else "rad" if name in _ANGLES else "quaternion"
        static.add_argument(
            f"--{name}", metavar=unit.upper(), type=number(), help=f"{name} ({unit})"
        )
    static.add_argument("--frame-id", metavar="PARENT", help="the parent frame")
    static.add_argument("--child-frame-id", metavar="CHILD", help="the child frame")
    static.add_argument(
        "--authority",
        metavar="NAME",
        default=AUTHORITY,
        help=f"name to publish as (default {AUTHORITY})",
    )
    static.set_defaults(run=_static, usage_error=static.error)


def _static(args: argparse.Namespace) -> int:
    parent, child, transform = _row(args) if args.words else _flags(args)
    return store(args, StampedTransform(parent, child, 0, transform), static=True)


def _row(args: argparse.Namespace) -> tuple[str, str, Transform]:
    """The link of arguments in a row."""
    given = [name for name in _names() if getattr(args, name) is not None]
    if given:
        _refuse(args, f"--{given[0].replace('_', '-')} cannot be combined with arguments in a row")
    if len(args.words) not in (8, 9):
        _refuse(args, f"give 6 or 7 numbers and two frames, not {len(args.words)} arguments")
    *words, parent, child = args.words
    try:
        numbers = [number()(word) for word in words]
    except argparse.ArgumentTypeError as error:
        _refuse(args, str(error))
    if len(numbers) == 7:
        return parent, child, Transform(numbers[:3], numbers[3:])
    yaw, pitch, roll = numbers[3:]
    return parent, child, _turned(numbers[:3], roll, pitch, yaw)


def _flags(args: argparse.Namespace) -> tuple[str, str, Transform]:
    """The link of flags."""
    if args.frame_id is None or args.child_frame_id is None:
        _refuse(args, "give --frame-id and --child-frame-id, or all arguments in a row")
    position = _values(args, _POSITION)
    has_quaternion = any(getattr(args, name) is not None for name in _QUATERNION)
    if has_quaternion and any(getattr(args, name) is not None for name in _ANGLES):
        _refuse(args, "give angles or a quaternion, not both")
    if has_quaternion:
        transform = Transform(position, _values(args, _QUATERNION))
    else:
        transform = _turned(position, *_values(args, _ANGLES))
    return args.frame_id, args.child_frame_id, transform


def _turned(position: Sequence[float], roll: float, pitch: float, yaw: float) -> Transform:
    return Transform.from_rpy(roll, pitch, yaw, translation=position)


def _values(args: argparse.Namespace, names: Sequence[str]) -> list[float]:
    return [getattr(args, name) or 0.0 for name in names]


def _names() -> list[str]:
    return [*_POSITION, *_ANGLES, *_QUATERNION, "frame_id", "child_frame_id"]


def _refuse(args: argparse.Namespace, message: str) -> NoReturn:
    args.usage_error(message)
    raise AssertionError  # argparse has ended the process
