"""``zenoh-tf frames``, ``frame``, ``authorities``, ``clients`` and ``stats``: what a tree has."""

from __future__ import annotations

import argparse
from dataclasses import asdict, fields
from typing import Final

from zenoh_tf import AuthorityInfo, FrameInfo, export
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.records import frame_infos
from zenoh_tf_tools.cli.types import Commands, examples


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    frames = commands.add_parser(
        "frames",
        parents=[common],
        help="draw the tree, with the rate and delay of each link",
        description="Draw the tree of frames, with the authority, rate, delay, buffer and counters "
        "of each link.",
        **examples("zenoh-tf frames", "zenoh-tf frames --dot | dot -Tsvg > frames.svg"),
    )
    forms = frames.add_mutually_exclusive_group()
    for flag, function, what in (
        ("--dot", export.dot, "a Graphviz digraph"),
        ("--mermaid", export.mermaid, "a Mermaid flowchart"),
    ):
        forms.add_argument(
            flag, dest="form", action="store_const", const=function, help=f"print {what}"
        )
    frames.set_defaults(run=_frames, usage_error=frames.error)

    frame = commands.add_parser(
        "frame",
        parents=[common],
        help="print everything known about one frame",
        description="Print everything that is known about a frame and its link to its parent.",
        **examples("zenoh-tf frame gripper"),
    )
    frame.add_argument("name", metavar="NAME")
    frame.set_defaults(run=_frame)

    authorities = commands.add_parser(
        "authorities",
        parents=[common],
        help="list the publishers, and what became of their transforms",
        description="Print for each authority: the frames that it wrote last, its commits, its "
        "transforms that were stored, dropped as too old, or rewritten at an equal stamp, how "
        "often it took over a frame of another authority (conflicts), its published transforms "
        "that the server refused, with the reason of the last refusal, its messages that were "
        "dropped because too many were waiting, and by how many seconds its stamps lead their "
        "arrival at the server, at least and at most: a clock that is exact has both a little "
        "below zero.",
        **examples("zenoh-tf authorities"),
    )
    authorities.set_defaults(run=_authorities)

    clients = commands.add_parser(
        "clients",
        parents=[common],
        help="list the clients, and how far their clocks are off",
        description="Print for each connected client: its Zenoh id, which the server's log names, "
        "its address, and by how many seconds its clock is ahead of the server's, at least and at "
        "most.",
        **examples("zenoh-tf clients"),
    )
    clients.set_defaults(run=_clients)

    stats = commands.add_parser(
        "stats",
        parents=[common],
        help="print the server's counters",
        description="Print the counters of the server and of its tree.",
        **examples("zenoh-tf stats --json"),
    )
    stats.set_defaults(run=_stats)


def _frames(args: argparse.Namespace) -> int:
    # argparse cannot exclude --json itself, because it may stand before the command.
    if args.json and args.form:
        args.usage_error("--json cannot be combined with --dot or --mermaid")
    with connect(args) as tf:
        frames = frame_infos(tf)
    if args.json:
        output.print_json({"tree": args.tree, "frames": [_document(frame) for frame in frames]})
    elif args.form:
        print(args.form(frames))
    else:
        print(export.text(frames, paint=output.paint))
    return 0


def _document(frame: FrameInfo) -> dict[str, object]:
    return asdict(frame) | {"rate_hz": frame.rate_hz, "delay_s": frame.delay_s()}


def _frame(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        frame = tf.frame(args.name)
    if args.json:
        output.print_json(_document(frame))
        return 0
    print(output.paint("frame", export.printable(frame.name)))
    for label, value in _facts(frame).items():
        print(output.row(label, value))
    return 0


def _facts(frame: FrameInfo) -> dict[str, str]:
    """Return the facts about a frame by their labels."""
    facts = {"parent": "none" if frame.parent is None else export.printable(frame.parent)}
    if frame.parent is not None:
        facts["authority"] = export.printable(frame.authority)
    if frame.static:
        facts["static"] = "holds at all times"
    elif frame.oldest_stamp_ns is not None and frame.newest_stamp_ns is not None:
        facts["rate"] = "-" if frame.rate_hz is None else f"{frame.rate_hz:.1f} Hz"
        facts["newest"] = output.when(frame.newest_stamp_ns)
        facts["oldest"] = output.when(frame.oldest_stamp_ns)
        facts["samples"] = f"{frame.samples:,}"
    for counter in ("rewritten", "dropped", "evicted", "reparented", "switched"):
        facts[counter] = f"{getattr(frame, counter):,}"
    facts["conflicts"] = f"{frame.authority_changes:,}"
    change = frame.last_change
    if change is not None:
        what = {"authority": "taken over"}.get(change.kind, change.kind)
        before = "none" if change.parent_before is None else export.printable(change.parent_before)
        facts["last change"] = f"{what} by {export.printable(change.authority)}"
        facts["  stamp"] = output.when(change.stamp_ns)
        facts["  before"] = f"parent {before}" + (", static" if change.static_before else "")
    facts["version"] = f"{frame.version:,}"
    return facts


#: How far its stamps lead their arrival at the server, in seconds: title and field.
_CLOCK_COLUMNS: Final = (("lead_min_s", "clock_offset_min_s"), ("lead_max_s", "clock_offset_max_s"))


def _authorities(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        authorities = tf.authorities()
    if args.json:
        records = [asdict(authority) for authority in authorities]
        output.print_json({"tree": args.tree, "authorities": records})
        return 0
    if not authorities:
        print("no authorities")
        return 0
    columns = [field.name for field in fields(AuthorityInfo) if field.type == "int"]
    width = max(len(export.printable(authority.name)) for authority in authorities)
    header = [" " * width, *columns, *(title for title, _ in _CLOCK_COLUMNS)]
    print(output.paint("header", "  ".join(header)))
    for authority in authorities:
        counts = "".join(f"  {getattr(authority, name):>{len(name)},}" for name in columns)
        clock = "".join(
            "  " + _seconds(getattr(authority, name)).rjust(len(title))
            for title, name in _CLOCK_COLUMNS
        )
        print(export.printable(authority.name).ljust(width) + counts + clock)
    for authority in authorities:
        if authority.last_refusal is not None:
            name, reason = (
                export.printable(authority.name),
                export.printable(authority.last_refusal),
            )
            print(f"last refusal of {name}: {reason}")
    return 0


def _clients(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        clients = tf.clients()
    if args.json:
        records = [asdict(client) for client in clients]
        output.print_json({"tree": args.tree, "clients": records})
        return 0
    rows = [("client", "address", "ahead_min_s", "ahead_max_s")]
    for client in clients:
        rows.append(
            (
                export.printable(client.client),
                "-" if client.address is None else export.printable(client.address),
                _seconds(client.clock_offset_min_s),
                _seconds(client.clock_offset_max_s),
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for number, (name, address, least, greatest) in enumerate(rows):
        line = "  ".join(
            (
                name.ljust(widths[0]),
                address.ljust(widths[1]),
                least.rjust(widths[2]),
                greatest.rjust(widths[3]),
            )
        )
        print(line if number else output.paint("header", line))
    return 0


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _stats(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        counters = tf.stats()
    if args.json:
        output.print_json(counters)
        return 0
    width = max(map(len, counters), default=0)
    for name, value in sorted(counters.items()):
        print(f"{name:<{width}}  {value:>14,}")
    return 0
