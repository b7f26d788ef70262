"""``zenoh-tf top``: a live board of links and publishers in the terminal."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import ServerUnavailable
from zenoh_tf.text import printable
from zenoh_tf_tools.cli.arguments import Commands, add_periods
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.output import Table
from zenoh_tf_tools.cli.show.monitor import authorities_table, links_table, pairs_table
from zenoh_tf_tools.cli.show.pair_delays import add_pairs
from zenoh_tf_tools.cli.show.rates import Period, periods
from zenoh_tf_tools.errors import extra

if TYPE_CHECKING:
    from rich.console import Group

#: Each order puts the largest first; a link without a figure comes last.
_ORDERS: Final = {
    "age": lambda link: (not link.stopped, -(link.greatest_age_s or 0.0)),
    "rate": lambda link: -link.commits_per_s,
    "name": lambda link: link.frame,
}


def add(commands: Commands) -> None:
    top = commands.add(
        "top",
        _top,
        "show the links and publishers on a live board",
        "Show the links and publishers on a board in the terminal, until Ctrl-C: links that "
        "have stopped are red and come first. The figures are those of zenoh-tf monitor. Needs the "
        "extra zenoh-tf[top].",
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
    with extra("top", "rich"):
        from rich.console import Console  # noqa: PLC0415 - an optional extra
        from rich.live import Live  # noqa: PLC0415
    console = Console()
    with connect(args) as tf, Live(console=console, screen=console.is_terminal) as live:

        def wait(error: ServerUnavailable) -> None:
            live.update(_text(f"{error} (waiting)"), refresh=True)

        for period in periods(tf, args, wait):
            # A table that is higher than the terminal would hide its own end.
            rows = console.height if console.is_terminal else len(period.links)
            live.update(_board(args.tree, period, args.sort, rows), refresh=True)
    return 0


def _board(tree: str, period: Period, order: str, rows: int) -> Group:
    """The board. `rows`: lines of the terminal; links that do not fit are counted."""
    from rich.console import Group  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    stopped = sum(link.stopped for link in period.links)
    title = Text(
        f"tree {tree!r}: {len(period.links):,} dynamic and {period.static_links:,} static links, "
        f"{len(period.authorities):,} publishers"
    )
    if stopped:
        title.append(f", {stopped:,} stopped", style="bold red")
    links = sorted(period.links, key=_ORDERS[order])
    pairs = [_drawn(pairs_table(period.pairs), {})] if period.pairs else []
    # The title, two headers with their rules, and the line that counts the rest.
    shown = max(3, rows - len(period.authorities) - (len(period.pairs) + 3 if pairs else 0) - 10)
    ahead = {n: "yellow" for n, link in enumerate(links) if (link.greatest_age_s or 0.0) < 0}
    still = {n: "bold red" for n, link in enumerate(links) if link.stopped}
    parts: list[Any] = [title, _drawn(links_table(links[:shown]), ahead | still)]
    if len(links) > shown:
        parts.append(Text(f"and {len(links) - shown:,} more links", style="dim"))
    lost = {n: "bold red" for n, x in enumerate(period.authorities) if x.refused or x.dropped}
    return Group(*parts, *pairs, _drawn(authorities_table(period.authorities), lost))


def _drawn(table: Table, styles: Mapping[int, str]) -> Any:
    """A table, with these rows in other colours."""
    from rich import box  # noqa: PLC0415
    from rich.table import Table as RichTable  # noqa: PLC0415

    titles, rows, texts = table
    drawn = RichTable(box=box.SIMPLE_HEAD, pad_edge=False)
    for number, title in enumerate(titles):
        left = number in texts
        drawn.add_column(_text(title), justify="left" if left else "right", no_wrap=True)
    for number, cells in enumerate(rows):
        drawn.add_row(*map(_text, cells), style=styles.get(number))
    return drawn


def _text(text: str) -> Any:
    """Text as it is: rich would read brackets as markup."""
    from rich.text import Text  # noqa: PLC0415

    return Text(printable(text))
