"""``zenoh-tf static``: store a static link, with the arguments of tf2's publisher."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Final, NoReturn

from zenoh_tf import StampedTransform
from zenoh_tf.text.flag_values import angle, number
from zenoh_tf_tools.cli.arguments import Commands, add_authority
from zenoh_tf_tools.cli.tree.write import AUTHORITY, pose_of, store

_USAGE: Final = """\
zenoh-tf static [options] X Y Z YAW PITCH ROLL PARENT CHILD
       zenoh-tf static [options] X Y Z QX QY QZ QW PARENT CHILD
       zenoh-tf static [options] [--x X] [--y Y] [--z Z]
                       [--roll R] [--pitch P] [--yaw Y] | [--qx X --qy Y --qz Z --qw W]
                       --frame-id PARENT --child-frame-id CHILD"""
#: The flags with a number, by their unit.
_UNITS: Final = {
    "m": ("x", "y", "z"),
    "rad": ("roll", "pitch", "yaw"),
    "quaternion": ("qx", "qy", "qz", "qw"),
}


def add(commands: Commands) -> None:
    static = commands.add(
        "static",
        _static,
        "store a static link, with tf2's argument forms",
        "Store the pose of CHILD in PARENT for all times: metres, and angles or a quaternion. The "
        "arguments are those of tf2's static_transform_publisher; an angle is in radians, up to a "
        "whole turn, or has its unit, as in 90deg. The server keeps the link, so the command ends.",
        "zenoh-tf static 0.1 0 0.25 0 0 0 base_link camera",
        "zenoh-tf static 0.1 0 0.25 -90deg 0 0 base_link camera",
        "zenoh-tf static 0.1 0 0.25 0 0 0 1 base_link camera",
        "zenoh-tf static --x 0.1 --yaw 1.5708 --frame-id base_link --child-frame-id camera",
    )
    static.usage = _USAGE
    static.add_argument("words", metavar="ARG", nargs="*", help="one of the two forms in a row")
    for unit, names in _UNITS.items():
        for name in names:
            static.add_argument(
                f"--{name}",
                metavar=unit.upper(),
                type=_type(name),
                help=f"{name} ({unit}{', or as in 90deg' if unit == 'rad' else ''})",
            )
    static.add_argument("--frame-id", metavar="PARENT", help="the parent frame")
    static.add_argument("--child-frame-id", metavar="CHILD", help="the child frame")
    add_authority(static, AUTHORITY)


def _static(args: argparse.Namespace) -> int:
    if args.words:
        _read_row(args)
    if args.frame_id is None or args.child_frame_id is None:
        _refuse(args, "give --frame-id and --child-frame-id, or all arguments in a row")
    position, quaternion = (
        [getattr(args, name) for name in _UNITS[unit]] for unit in ("m", "quaternion")
    )
    is_turned = any(value is not None for value in quaternion)
    turn = [value or 0.0 for value in quaternion] if is_turned else None
    pose = pose_of(args, [value or 0.0 for value in position], turn)
    stamped = StampedTransform(args.frame_id, args.child_frame_id, 0, pose)
    return store(args, stamped, static=True)


def _read_row(args: argparse.Namespace) -> None:
    """Read the arguments in a row as if they were flags."""
    for name in (*sum(_UNITS.values(), ()), "frame_id", "child_frame_id"):
        if getattr(args, name) is not None:
            flag = f"--{name.replace('_', '-')}"
            _refuse(args, f"{flag} cannot be combined with arguments in a row: {args.words}")
    _refuse_period(args)
    if len(args.words) not in (8, 9):
        _refuse(args, f"give 6 or 7 numbers and two frames, not {len(args.words)} arguments")
    *words, args.frame_id, args.child_frame_id = args.words
    rotation = reversed(_UNITS["rad"]) if len(words) == 6 else _UNITS["quaternion"]
    try:
        for name, word in zip((*_UNITS["m"], *rotation), words, strict=True):
            setattr(args, name, _type(name)(word.strip()))
    except argparse.ArgumentTypeError as error:
        _refuse(args, str(error))


def _refuse_period(args: argparse.Namespace) -> None:
    """Refuse the last argument of the publisher of tf, which that of tf2 has no more."""
    *words, period = args.words
    if len(words) in (8, 9) and _is_number(period) and not _is_number(words[-2]):
        _refuse(args, f"leave out the period {period!r}: a static link holds until it is replaced")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _type(name: str) -> Callable[[str], float]:
    """What a flag reads."""
    return angle(bare=True) if name in _UNITS["rad"] else number()


def _refuse(args: argparse.Namespace, message: str) -> NoReturn:
    args.usage_error(message)
    raise AssertionError  # argparse has ended the process
