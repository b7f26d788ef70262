"""``zenoh-tf top``: the tables of `zenoh-tf monitor` as a live board in the terminal."""

from __future__ import annotations

import argparse
import shutil
import sys
from typing import Final

from zenoh_tf.text import printable
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_periods
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.show.monitor import authorities_table, links_table, pairs_table
from zenoh_tf_tools.cli.show.pair_delays import add_pairs
from zenoh_tf_tools.cli.show.rates import Period, periods

#: Each order puts the largest first; a link without a figure comes last.
_ORDERS: Final = {
    "age": lambda link: (not link.stopped, -(link.greatest_age_s or 0.0)),
    "rate": lambda link: -link.commits_per_s,
    "name": lambda link: link.frame,
}
#: The terminal's second screen without wrapped lines, and back; and an empty screen.
_BEGIN, _END, _CLEAR = "\x1b[?1049h\x1b[?7l", "\x1b[?7h\x1b[?1049l", "\x1b[H\x1b[J"


def add(commands: Commands) -> None:
    top = commands.add(
        "top",
        _top,
        "show the links and publishers on a live board",
        "Show the links and publishers on a board in the terminal, until Ctrl-C: links that have "
        "stopped are red and come first. The figures are those of zenoh-tf monitor.",
        "zenoh-tf top",
        "zenoh-tf top --every 500ms --sort rate",
    )
    add_periods(top, 1)
    add_pairs(top)
    top.add_argument(
        "--sort", choices=_ORDERS, default="age", help="the order of the links (default age)"
    )


def _top(args: argparse.Namespace) -> int:
    if args.json:
        args.usage_error("a board has no --json; use zenoh-tf monitor --json")
    begin, end, clear = (_BEGIN, _END, _CLEAR) if sys.stdout.isatty() else ("", "", "")
    with connect(args) as tf:
        try:
            print(end=begin)
            for period in periods(tf, args, lambda error: print(f"{error} (waiting)", flush=True)):
                # A table that is higher than the terminal would hide its own end.
                rows = shutil.get_terminal_size().lines if clear else len(period.links) + 100
                print(clear + board(args.tree, period, args.sort, rows), flush=True)
        finally:
            print(end=end, flush=True)
    return 0


def board(tree: str, period: Period, order: str, rows: int) -> str:
    """The board. `rows`: lines of the terminal; links that do not fit are counted."""
    stopped = sum(link.stopped for link in period.links)
    title = (
        f"tree {printable(tree)!r}: {len(period.links):,} dynamic and {period.static_links:,} "
        f"static links, {len(period.authorities):,} publishers"
    )
    if stopped:
        title += ", " + output.paint("stopped", f"{stopped:,} stopped")
    links = sorted(period.links, key=_ORDERS[order])
    # The title, two headers, three empty lines, and the line that counts the rest.
    taken = len(period.authorities) + (len(period.pairs) + 2 if period.pairs else 0) + 7
    shown = links[: max(3, rows - taken)]
    parts = ["stopped" if x.stopped else "late" * ((x.greatest_age_s or 0) < 0) for x in shown]
    lines = [title, "", *output.table(*links_table(shown), parts)]
    if len(links) > len(shown):
        lines.append(output.paint("branch", f"and {len(links) - len(shown):,} more links"))
    if period.pairs:
        lines += ["", *output.table(*pairs_table(period.pairs))]
    lost = ["stopped" if x.refused or x.dropped else "" for x in period.authorities]
    return "\n".join([*lines, "", *output.table(*authorities_table(period.authorities), lost)])
