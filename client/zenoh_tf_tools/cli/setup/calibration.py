"""``zenoh-tf calibration``: save, load and compare named sets of static links."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

from zenoh_tf import FrameInfo, StampedTransform, Transform
from zenoh_tf.text import printable
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_authority
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.records import frame_infos
from zenoh_tf_tools.cli.setup import calibration_diff as diff
from zenoh_tf_tools.cli.setup import calibration_files as files
from zenoh_tf_tools.cli.setup.calibration_files import LIVE, Folder, Links, Reference
from zenoh_tf_tools.errors import CommandError

T = TypeVar("T")

_EXAMPLES: Final = (
    'zenoh-tf calibration save cell --note "after the camera was replaced"',
    "zenoh-tf calibration list",
    "zenoh-tf calibration diff cell           # what has changed since, on the server",
    "zenoh-tf calibration diff cell@1 cell@2",
    "zenoh-tf calibration load cell@1 --dry-run",
    "zenoh-tf calibration load cell@1",
)
#: Links of one request, and how often links that change meanwhile are read again.
_LINKS_AT_ONCE: Final = 1000
_READ_ATTEMPTS: Final = 5


def add(commands: Commands) -> None:
    """Add the command."""
    calibration = commands.add(
        "calibration",
        None,
        "save, load and compare named sets of static links",
        "Named, versioned sets of static links, one TOML file per version.",
        *_EXAMPLES,
    )
    folder = argparse.ArgumentParser(add_help=False)
    folder.add_argument(
        "--dir",
        metavar="DIR",
        type=Path,
        default=files.default_folder(),
        help="where the files are (default: zenoh-tf/calibrations in $XDG_DATA_HOME, else in "
        "~/.local/share)",
    )
    parsers = calibration.add_subparsers(title="actions", metavar="ACTION", required=True)
    _add_actions(Commands(parsers, *commands.parents, folder))


def _add_actions(actions: Commands) -> None:
    save = actions.add(
        "save",
        _save,
        "write the tree's static links to a file",
        "Write the tree's static links, read at one instant, as the next version of NAME.",
        *_EXAMPLES,
    )
    save.add_argument("name", metavar="NAME", type=_usage(files.parse_name))
    save.add_argument(
        "--frame",
        metavar="CHILD",
        action="append",
        help="only the link of this child frame; repeatable",
    )
    save.add_argument("--note", metavar="TEXT", default="", help="a remark to keep with it")

    load = actions.add(
        "load",
        _load,
        "set the static links of a file",
        "Print what NAME changes, then set its static links in one transaction. Other links stay.",
        *_EXAMPLES,
    )
    load.add_argument("reference", metavar="NAME[@VERSION]", type=_usage(files.parse_reference))
    load.add_argument("--dry-run", action="store_true", help="only print what would change")
    add_authority(load, "calibration")

    compare = actions.add(
        "diff",
        _diff,
        "compare two calibrations, or one with the server",
        "Print how each link differs: the translation in millimetres, the rotation in degrees.",
        *_EXAMPLES,
    )
    compare.add_argument("before", metavar="NAME[@VERSION]", type=_usage(files.parse_reference))
    compare.add_argument(
        "after",
        metavar="NAME2[@VERSION]|live",
        nargs="?",
        default=LIVE,
        type=_usage(lambda text: text if text == LIVE else files.parse_reference(text)),
        help="live, the default: the static links of the server",
    )

    list_ = actions.add(
        "list",
        _list,
        "list the calibrations",
        "List the versions of NAME, or of all calibrations.",
        *_EXAMPLES,
    )
    list_.add_argument("name", metavar="NAME", nargs="?", type=_usage(files.parse_name))


def _usage(parse: Callable[[str], T]) -> Callable[[str], T]:
    """An argparse type whose errors are shown as they are."""

    def convert(text: str) -> T:
        try:
            return parse(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return convert


def _save(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        links, _ = _live(tf)
    if args.frame:
        for child in args.frame:
            if child not in links:
                raise CommandError(f"frame {child!r} has no static link in tree {args.tree!r}")
        links = {child: links[child] for child in args.frame}
    if not links:
        raise CommandError(f"tree {args.tree!r} has no static links")
    folder = Folder(args.dir)
    saved = folder.save(args.name, links, args.tree, args.note)
    path = folder.path / f"{saved.reference}.toml"
    document = {"saved": str(saved.reference), "links": len(links), "file": str(path)}
    output.show(args, document, f"{saved.reference}: {_count(len(links))} saved to {path}")
    return 0


def _load(args: argparse.Namespace) -> int:
    calibration = Folder(args.dir).load(args.reference)
    with connect(args) as tf:
        static, dynamic = _live(tf)
        known = {child: static[child] for child in calibration.links if child in static}
        differences = diff.compare(known, calibration.links)
        is_changed = any(each.kind != "same" for each in differences)
        if not args.json:
            print(diff.text(differences, dynamic))
        applied = is_changed and not args.dry_run
        if applied:
            rows = list(calibration.links.values())
            tf.set_transforms_xact(rows, authority=args.authority, static=True)
    if applied:
        result = f"{_count(len(calibration.links))} set"
    else:
        result = "nothing was set (--dry-run)" if is_changed else "nothing to set"
    document = {
        "calibration": str(calibration.reference),
        "applied": applied,
        "links": [each.document() for each in differences],
    }
    output.show(args, document, f"{calibration.reference}: {result}")
    return 0


def _diff(args: argparse.Namespace) -> int:
    folder = Folder(args.dir)
    before = folder.load(args.before)
    if isinstance(args.after, Reference):
        after = folder.load(args.after)
        name, links = str(after.reference), after.links
    else:
        with connect(args) as tf:
            name, (links, _) = f"tree {printable(args.tree)!r}", _live(tf)
    differences = diff.compare(before.links, links)
    document = {
        "before": str(before.reference),
        "after": LIVE if args.after == LIVE else name,
        "links": [each.document() for each in differences],
    }
    text = f"from {before.reference} to {name}\n{diff.text(differences)}"
    output.show(args, document, text)
    return 0


def _list(args: argparse.Namespace) -> int:
    folder = Folder(args.dir)
    found = [folder.load(reference) for reference in folder.references(args.name)]
    document = [
        {
            "name": each.reference.name,
            "version": each.reference.version,
            "saved": each.saved,
            "tree": each.tree,
            "links": len(each.links),
            "note": each.note,
        }
        for each in found
    ]
    width = max((len(str(each.reference)) for each in found), default=0)
    lines = []
    for each in found:
        reference = output.paint("frame", str(each.reference).ljust(width))
        line = f"{reference}  {each.saved}  {_count(len(each.links)):>11}"
        lines.append(f"{line}  {printable(each.note)}".rstrip())
    output.show(args, document, "\n".join(lines) or f"no calibrations in {folder.path}")
    return 0


def _count(links: int) -> str:
    return f"{links} link" if links == 1 else f"{links} links"


def _live(tf: TransformClient) -> tuple[Links, set[str]]:
    """The static links of the server's tree at one instant, and the children of the dynamic ones.

    It reads which static links there are, then their poses, until nothing changes in between.
    """
    before = _frames(tf)
    for _ in range(_READ_ATTEMPTS):
        statics = {each.name: each for each in before.values() if each.static}
        pairs = [(each.parent or "", each.name) for each in statics.values()]
        poses = []
        for start in range(0, len(pairs), _LINKS_AT_ONCE):
            poses += tf.lookup_latest_transforms_xact(pairs[start : start + _LINKS_AT_ONCE])
        after = _frames(tf)
        if {name: after[name].version for name in statics if name in after} == {
            name: each.version for name, each in statics.items()
        } and statics.keys() == {each.name for each in after.values() if each.static}:
            links = {
                child: StampedTransform(
                    parent, child, 0, Transform(pose.transform.translation, pose.transform.rotation)
                )
                for (parent, child), pose in zip(pairs, poses, strict=True)
            }
            dynamic = {each.name for each in after.values() if each.parent and not each.static}
            return links, dynamic
        before = after
    raise CommandError("the static links change all the time; try again later")


def _frames(tf: TransformClient) -> dict[str, FrameInfo]:
    return {frame.name: frame for frame in frame_infos(tf)}
