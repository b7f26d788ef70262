"""``zenoh-tf calibration``: save, load and compare the static links of a tree, as a TOML file."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf.text import printable, toml
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_authority
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.records import frame_infos
from zenoh_tf_tools.errors import CommandError

#: The static links of a file or a tree, by child frame.
Links = Mapping[str, StampedTransform]

_EXAMPLES: Final = (
    "zenoh-tf calibration save cell.toml",
    "zenoh-tf calibration diff cell.toml           # what has changed since",
    "zenoh-tf calibration load cell.toml --dry-run",
    "zenoh-tf calibration load cell.toml",
)
#: Links of one request, and how often links that change meanwhile are read again.
_LINKS_AT_ONCE: Final = 1000
_READ_ATTEMPTS: Final = 5
#: A quaternion written by hand may have few digits; the server makes its length 1.
_ROTATION_TOLERANCE: Final = 1e-3
#: Smaller differences are rounding.
_SAME_MM: Final = 1e-6
_SAME_DEG: Final = 1e-6


def add(commands: Commands) -> None:
    """Add the command."""
    calibration = commands.add(
        "calibration",
        None,
        "save, load and compare the static links as a file",
        "The static links of a tree as a TOML file. Keep its versions in git.",
        *_EXAMPLES,
    )
    parsers = calibration.add_subparsers(title="actions", metavar="ACTION", required=True)
    actions = Commands(parsers, *commands.parents)
    save = actions.add(
        "save",
        _save,
        "write the tree's static links to a file",
        "Write the tree's static links, read at one instant, to FILE, in place of an older one.",
        *_EXAMPLES,
    )
    load = actions.add(
        "load",
        _load,
        "set the static links of a file",
        "Print what FILE changes, then set its static links in one transaction. Other links stay.",
        *_EXAMPLES,
    )
    diff = actions.add(
        "diff",
        _diff,
        "compare a file with the server",
        "Print how each link differs: the translation in millimetres, the rotation in degrees.",
        *_EXAMPLES,
    )
    for parser in (save, load, diff):
        parser.add_argument("file", metavar="FILE", type=Path, help="the TOML file")
    save.add_argument(
        "--frame",
        metavar="CHILD",
        action="append",
        default=[],
        help="only the link of this child frame; repeatable",
    )
    load.add_argument("--dry-run", action="store_true", help="only print what would change")
    add_authority(load, "calibration")


def _save(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        links = _static_links(tf)
    for child in args.frame:
        if child not in links:
            raise CommandError(f"frame {child!r} has no static link in tree {args.tree!r}")
    links = {child: link for child, link in links.items() if not args.frame or child in args.frame}
    if not links:
        raise CommandError(f"tree {args.tree!r} has no static links")
    try:
        _write(args.file, _toml(links))
    except OSError as error:
        raise CommandError(f"cannot write {args.file}: {error.strerror}") from error
    document = {"links": len(links), "file": str(args.file)}
    output.show(args, document, f"{_count(len(links))} saved to {args.file}")
    return 0


def _load(args: argparse.Namespace) -> int:
    saved = _read(args.file)
    with connect(args) as tf:
        live = _static_links(tf)
        known = {child: live[child] for child in saved if child in live}
        differences = _differences(known, saved)
        is_changed = any(each["kind"] != "same" for each in differences)
        if not args.json:
            print(_text(differences))
        applied = is_changed and not args.dry_run
        if applied:
            rows = list(saved.values())
            tf.set_transforms_xact(rows, authority=args.authority, static=True)
    result = f"{_count(len(saved))} set" if applied else "nothing to set"
    if is_changed and not applied:
        result = "nothing was set (--dry-run)"
    document = {"applied": applied, "file": str(args.file), "links": differences}
    output.show(args, document, f"{args.file}: {result}")
    return 0


def _diff(args: argparse.Namespace) -> int:
    saved = _read(args.file)
    with connect(args) as tf:
        differences = _differences(saved, _static_links(tf))
    text = f"from {args.file} to tree {printable(args.tree)!r}\n{_text(differences)}"
    output.show(args, {"file": str(args.file), "links": differences}, text)
    return 0


def _count(links: int) -> str:
    return f"{links} link" if links == 1 else f"{links} links"


def _static_links(tf: TransformClient) -> dict[str, StampedTransform]:
    """The static links of the server's tree at one instant.

    It reads which static links there are, then their poses, until nothing changes in between.
    """
    before = _versions(tf)
    for _ in range(_READ_ATTEMPTS):
        pairs = list(before)
        poses = []
        for start in range(0, len(pairs), _LINKS_AT_ONCE):
            poses += tf.lookup_latest_transforms_xact(pairs[start : start + _LINKS_AT_ONCE])
        after = _versions(tf)
        if before == after:
            return {
                child: StampedTransform(
                    parent, child, 0, Transform(pose.transform.translation, pose.transform.rotation)
                )
                for (parent, child), pose in zip(pairs, poses, strict=True)
            }
        before = after
    raise CommandError("the static links change all the time; try again later")


def _versions(tf: TransformClient) -> dict[tuple[str, str], int]:
    """The version of each static link, by its parent and child."""
    return {(each.parent or "", each.name): each.version for each in frame_infos(tf) if each.static}


def _differences(before: Links, after: Links) -> list[dict[str, Any]]:
    """How each link differs, by child frame, as JSON values; also of links that are the same.

    `offset_mm`, how far the child has moved along the parent's axes, and `rotation_deg`, the angle
    between the two rotations, are None unless the child has one parent.
    """
    return [
        _difference(child, before.get(child), after.get(child))
        for child in sorted(before.keys() | after.keys())
    ]


def _difference(
    child: str, before: StampedTransform | None, after: StampedTransform | None
) -> dict[str, Any]:
    found: dict[str, Any] = {
        "child": child,
        "kind": "reparented",
        "parent_before": before and before.parent_frame,
        "parent_after": after and after.parent_frame,
        **dict.fromkeys(("translation_mm", "offset_mm", "rotation_deg")),
    }
    if before is None or after is None:
        found["kind"] = "added" if before is None else "removed"
    elif before.parent_frame == after.parent_frame:
        offset = 1000 * (after.transform.translation - before.transform.translation)
        x, y, z, w = (before.transform.inverse() @ after.transform).rotation.tolist()
        angle_deg = math.degrees(2 * math.atan2(math.hypot(x, y, z), abs(w)))
        length_mm = math.hypot(*offset)
        found["kind"] = "same" if length_mm < _SAME_MM and angle_deg < _SAME_DEG else "moved"
        found["translation_mm"], found["offset_mm"] = length_mm, offset.tolist()
        found["rotation_deg"] = angle_deg
    return found


def _text(differences: list[dict[str, Any]]) -> str:
    """Differences as lines, without the links that are the same."""
    changed = [each for each in differences if each["kind"] != "same"]
    width = max((len(printable(each["child"])) for each in changed), default=0)
    same = len(differences) - len(changed)
    lines = [_line(each, width) for each in changed]
    return "\n".join([*lines, f"{same} {'link is' if same == 1 else 'links are'} the same"])


def _line(each: dict[str, Any], width: int) -> str:
    name = output.paint("frame", printable(each["child"]).ljust(width))
    before, after = (printable(each[key] or "") for key in ("parent_before", "parent_after"))
    match each["kind"]:
        case "added":
            return f"+ {name}  new in {after}"
        case "removed":
            return f"- {name}  only before, in {before}"
        case "reparented":
            return f"> {name}  from {before} to {after}"
    x, y, z = (value + 0.0 for value in each["offset_mm"])
    return (
        f"~ {name}  {each['translation_mm']:10.3f} mm {each['rotation_deg']:9.4f} deg"
        f"   x {x:+.3f}  y {y:+.3f}  z {z:+.3f} mm in {after}"
    )


def _toml(links: Links) -> str:
    """The file: a block of lines per link, in the order of the child frames."""
    blocks = [
        "# Static poses of child in parent, by zenoh-tf calibration.\n"
        "# translation in metres, rotation as quaternion x y z w\n"
    ]
    for child, link in sorted(links.items()):
        numbers = (link.transform.translation.tolist(), link.transform.rotation.tolist())
        translation, rotation = ([value + 0.0 for value in values] for values in numbers)
        blocks.append(
            f"[[link]]\nchild = {_quoted(child)}\nparent = {_quoted(link.parent_frame)}\n"
            f"translation = {translation}\nrotation = {rotation}\n"
        )
    return "\n".join(blocks)


def _quoted(value: str) -> str:
    """A TOML string: JSON's form, which leaves only DEL to be escaped."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")


def _write(path: Path, text: str) -> None:
    """Replace a file, which is whole at any time."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _read(path: Path) -> dict[str, StampedTransform]:
    """The links of a file. Raises CommandError if it cannot be read or is malformed."""
    try:
        links = toml.loads(path.read_text(encoding="utf-8")).get("link")
        if not isinstance(links, list):
            raise ValueError("it has no [[link]]")
        read = [_link(entry, f" of link {number}") for number, entry in enumerate(links, start=1)]
    except (OSError, ValueError) as error:  # ValueError: also not UTF-8, or not TOML
        reason = error.strerror if isinstance(error, OSError) else error
        raise CommandError(f"cannot read {path}: {reason}") from error
    except RecursionError:
        raise CommandError(f"cannot read {path}: it is nested too deeply") from None
    by_child: dict[str, StampedTransform] = {}
    for link in read:
        if by_child.setdefault(link.child_frame, link) is not link:
            raise CommandError(f"cannot read {path}: {link.child_frame!r} is there twice")
    return by_child


def _link(entry: Any, where: str) -> StampedTransform:
    """One link. Raises ValueError, with a message, if it is malformed."""
    table = entry if isinstance(entry, dict) else {}
    for name in ("child", "parent"):
        if not isinstance(table.get(name), str):
            raise ValueError(f"{name}{where} is missing, or is no string")
    translation = _vector(table, "translation", 3, where)
    rotation = _vector(table, "rotation", 4, where)
    if abs(math.hypot(*rotation) - 1) > _ROTATION_TOLERANCE:
        raise ValueError(f"rotation{where} is not a unit quaternion")
    try:
        pose = Transform(translation, rotation)
        return StampedTransform(table["parent"], table["child"], 0, pose)
    except (TransformException, ValueError) as error:
        raise ValueError(f"{table['child']!r}{where}: {error}") from error


def _vector(table: dict[str, Any], name: str, size: int, where: str) -> list[float]:
    values = table.get(name)
    if isinstance(values, list) and len(values) == size and all(map(_is_finite, values)):
        return [float(value) for value in values]
    raise ValueError(f"{name}{where} is not {size} finite numbers")


def _is_finite(value: Any) -> bool:
    """Whether it is a number that a finite float can hold; TOML's whole numbers have no limit."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max
