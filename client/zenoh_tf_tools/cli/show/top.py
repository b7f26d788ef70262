"""``zenoh-tf top``: a live board of links and publishers in the terminal."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import ServerUnavailable
from zenoh_tf.text import printable
from zenoh_tf_tools.cli.arguments import Commands, add_periods
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.output import figure
from zenoh_tf_tools.cli.quit_key import ends_on_q
from zenoh_tf_tools.cli.show.pair_delays import PairDelay, add_pairs
from zenoh_tf_tools.cli.show.rates import LinkRate, Period, watch
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
        "Show the links and publishers on a board in the terminal, until q or Ctrl-C: links that "
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
    with (
        connect(args) as tf,
        ends_on_q(),  # first, as a board replaces stdout
        Live(console=console, screen=console.is_terminal) as live,
    ):
        shown = 0
        while shown != args.count:
            try:
                period = watch(tf, args.every, args.pairs)
            except ServerUnavailable as error:
                live.update(_name(f"{error} (waiting)"), refresh=True)
                time.sleep(args.every)
                continue
            # A table that is higher than the terminal would hide its own end.
            rows = console.height if console.is_terminal else len(period.links)
            board = _board(args.tree, period, args.sort, rows)
            live.update(board, refresh=True)
            shown += 1
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
    # The title, two headers with their rules, and the line that counts the rest.
    pairs = [_pairs(period.pairs)] if period.pairs else []
    shown = max(3, rows - len(period.authorities) - (len(period.pairs) + 3 if pairs else 0) - 10)
    parts: list[Any] = [title, _links(links[:shown])]
    if len(links) > shown:
        parts.append(Text(f"and {len(links) - shown:,} more links", style="dim"))
    return Group(*parts, *pairs, _authorities(period))


def _links(links: list[LinkRate]) -> Any:
    table = _table("link", "writes/s", "rate [Hz]", "least age [s]", "greatest [s]", "authority")
    for link in links:
        late = link.greatest_age_s is not None and link.greatest_age_s < 0
        table.add_row(
            _name(f"{link.parent} -> {link.frame}"),
            f"{link.commits_per_s:.1f}",
            figure(link.rate_hz, 1),
            figure(link.least_age_s, 3),
            figure(link.greatest_age_s, 3),
            _name(link.authority),
            style="bold red" if link.stopped else "yellow" if late else None,
        )
    return table


def _pairs(pairs: Sequence[PairDelay]) -> Any:
    table = _table("pair", "least delay [s]", "greatest [s]", "oldest link")
    for pair in pairs:
        table.add_row(
            _name(f"{pair.target} <- {pair.source}"),
            figure(pair.least_delay_s, 3),
            figure(pair.greatest_delay_s, 3),
            _name(pair.oldest_link or pair.problem or ""),
        )
    return table


def _authorities(period: Period) -> Any:
    table = _table("authority", "commits/s", "transforms/s", "dropped", "refused", "lead [s]")
    for each in period.authorities:
        table.add_row(
            _name(each.authority),
            f"{each.commits_per_s:.1f}",
            f"{each.transforms_per_s:.1f}",
            f"{each.dropped:,}",
            f"{each.refused:,}",
            figure(each.lead_max_s, 3),
            style="bold red" if each.refused or each.dropped else None,
        )
    return table


def _table(*titles: str) -> Any:
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title in titles:
        is_text = title in ("link", "authority", "pair", "oldest link")
        table.add_column(_name(title), justify="left" if is_text else "right", no_wrap=True)
    return table


def _name(text: str) -> Any:
    """A name as it is: rich would read brackets as markup."""
    from rich.text import Text  # noqa: PLC0415

    return Text(printable(text))
