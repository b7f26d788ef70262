"""``zenoh-tf frames``, ``frame``, ``authorities``, ``clients`` and ``stats``: what a tree has."""

from __future__ import annotations

import argparse
from dataclasses import asdict, fields

from zenoh_tf import AuthorityInfo, FrameInfo, export
from zenoh_tf.introspection.metric_table import FROM_ROBOTS, FROM_STATS
from zenoh_tf.text import printable
from zenoh_tf_client.session.mapped_tree import COUNTERS
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.records import frame_infos


def add(commands: Commands) -> None:
    frames = commands.add(
        "frames",
        _frames,
        "draw the tree, with the rate and delay of each link",
        "Draw the tree of frames, with the authority, rate, delay, buffer and counters of each "
        "link.",
        "zenoh-tf frames",
        "zenoh-tf frames --dot | dot -Tsvg > frames.svg",
    )
    forms = frames.add_mutually_exclusive_group()
    for flag, function, form in (
        ("--dot", export.dot, "a Graphviz digraph"),
        ("--mermaid", export.mermaid, "a Mermaid flowchart"),
    ):
        forms.add_argument(
            flag, dest="form", action="store_const", const=function, help=f"print {form}"
        )
    frame = commands.add(
        "frame",
        _frame,
        "print everything known about one frame",
        "Print everything that is known about a frame and its link to its parent.",
        "zenoh-tf frame gripper",
    )
    frame.add_argument("name", metavar="FRAME")
    commands.add(
        "authorities",
        _authorities,
        "list the publishers, and what became of their transforms",
        "Print for each authority: the frames that it wrote last, its commits, its transforms that "
        "were stored, dropped as too old, or rewritten at an equal stamp, how often it took over a "
        "frame of another authority (conflicts), its published transforms that the server refused, "
        "with the reason of the last refusal, its messages that were dropped because too many were "
        "waiting, and by how many seconds its stamps lead their arrival at the server, at least "
        "and at most: a clock that is exact has both a little below zero.",
        "zenoh-tf authorities",
    )
    commands.add(
        "clients",
        _clients,
        "list the clients, and how far their clocks are off",
        "Print for each connected client: its Zenoh id, which the server's log names, its address, "
        "and by how many seconds its clock is ahead of the server's, at least and at most.",
        "zenoh-tf clients",
    )
    commands.add(
        "stats",
        _stats,
        "print the server's counters, and what they count",
        "Print the counters of the server, of its tree and of this client's reads, and what each "
        "counts.",
        "zenoh-tf stats --json",
    )


def _frames(args: argparse.Namespace) -> int:
    # argparse cannot exclude --json itself, because it may stand before the command.
    if args.json and args.form:
        args.usage_error("--json cannot be combined with --dot or --mermaid")
    with connect(args) as tf:
        frames = frame_infos(tf)
    if args.json:
        output.print_json({"tree": args.tree, "frames": [_document(frame) for frame in frames]})
    else:
        print(args.form(frames) if args.form else export.text(frames, paint=output.paint))
    return 0


def _document(frame: FrameInfo) -> dict[str, object]:
    return asdict(frame) | {"rate_hz": frame.rate_hz, "delay_s": frame.delay_s()}


def _frame(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        frame = tf.frame(args.name)
    rows = [output.row(label, value) for label, value in _facts(frame).items()]
    name = output.paint("frame", printable(frame.name))
    output.show(args, _document(frame), "\n".join([name, *rows]))
    return 0


def _facts(frame: FrameInfo) -> dict[str, str]:
    """Return the facts about a frame by their labels."""
    facts = {"parent": "none" if frame.parent is None else printable(frame.parent)}
    if frame.parent is not None:
        facts["authority"] = printable(frame.authority)
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
    if frame.late_failures or frame.late_waits:
        facts["late"] = f"lookups: {frame.late_failures:,} failed, {frame.late_waits:,} waited"
    change = frame.last_change
    if change is not None:
        done = {"authority": "taken over"}.get(change.kind, change.kind)
        before = "none" if change.parent_before is None else printable(change.parent_before)
        facts["last change"] = f"{done} by {printable(change.authority)}"
        is_static = frame.static and change.stamp_ns == 0
        facts["  stamp"] = "static" if is_static else output.when(change.stamp_ns)
        by = f" by {printable(change.authority_before)}" if change.authority_before else ""
        facts["  before"] = f"parent {before}" + (", static" if change.static_before else "") + by
    replaced = frame.last_replacement
    if replaced is not None:
        facts["replaced"] = f"{replaced.count:,}, the last {output.when(replaced.at_ns)}"
        facts["  by"] = f"{replaced.shift_m:.6f} m, {replaced.turn_rad:.6f} rad"
    facts["version"] = f"{frame.version:,}"
    return facts


def _authorities(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        authorities = tf.authorities()
    counters = [field.name for field in fields(AuthorityInfo) if field.type == "int"]
    rows = [
        (
            printable(each.name),
            *(f"{getattr(each, name):,}" for name in counters),
            # How far its stamps lead their arrival at the server.
            output.figure(each.clock_offset_min_s, 3),
            output.figure(each.clock_offset_max_s, 3),
        )
        for each in authorities
    ]
    lines = output.table(("", *counters, "lead_min_s", "lead_max_s"), rows, texts=(0,))
    for each in authorities:
        if each.last_refusal is not None:
            reason = printable(each.last_refusal)
            lines.append(f"last refusal of {printable(each.name)}: {reason}")
    document = {"tree": args.tree, "authorities": [asdict(each) for each in authorities]}
    output.show(args, document, "\n".join(lines) if authorities else "no authorities")
    return 0


def _clients(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        clients = tf.clients()
    rows = [
        (
            printable(each.client),
            "-" if each.address is None else printable(each.address),
            output.figure(each.clock_offset_min_s, 3),
            output.figure(each.clock_offset_max_s, 3),
        )
        for each in clients
    ]
    lines = output.table(("client", "address", "ahead_min_s", "ahead_max_s"), rows, texts=(0, 1))
    document = {"tree": args.tree, "clients": [asdict(each) for each in clients]}
    output.show(args, document, "\n".join(lines))
    return 0


def _meaning(counter: str) -> str:
    """What a counter counts; nothing for one of a newer server."""
    if counter in COUNTERS:
        return COUNTERS[counter]
    kind, _, robot = counter.partition("/")
    metric = FROM_ROBOTS.get(kind) if robot else FROM_STATS.get(counter)
    return "" if metric is None else metric.meaning


def _stats(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        counters = tf.stats()
    width = max(map(len, counters), default=0)
    lines = [
        f"{name:<{width}}  {value:>14,}  {_meaning(name)}".rstrip()
        for name, value in sorted(counters.items())
    ]
    output.show(args, counters, "\n".join(lines))
    return 0
