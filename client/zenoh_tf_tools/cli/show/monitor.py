"""``zenoh-tf monitor``: rates, delays and ages, period by period."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict

from zenoh_tf.text import printable
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_periods
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.show.pair_delays import PairDelay, add_pairs
from zenoh_tf_tools.cli.show.rates import AuthorityRate, LinkRate, Period, periods


def add(commands: Commands) -> None:
    monitor = commands.add(
        "monitor",
        _monitor,
        "print the rates and delays of links and publishers, again and again",
        "Print for each period the links and the authorities: how often a link was written in it, "
        "the rate of its history, the least and the greatest age of its newest stamp (the least is "
        "about its delay); for an authority its commits and transforms, what was dropped and "
        "refused, and by how much its stamps lead their arrival. --json prints one document per "
        "line. Continues if the server ends and comes back; Ctrl-C ends it.",
        "zenoh-tf monitor",
        "zenoh-tf monitor --pair map gripper --pair map camera",
        "zenoh-tf monitor --every 500ms --count 2 --json",
    )
    add_periods(monitor, 2)
    add_pairs(monitor)


def _monitor(args: argparse.Namespace) -> int:
    with connect(args) as tf:
        shown = periods(tf, args, lambda error: output.report_waiting(error, args.json))
        for number, period in enumerate(shown):
            if args.json:
                output.print_json({"tree": args.tree, **asdict(period)})
            else:
                print(f"\n{text(period)}" if number else text(period))
            sys.stdout.flush()
    return 0


def text(period: Period) -> str:
    """A period as tables."""
    lines = [
        f"in {period.seconds:.1f} s: {len(period.links):,} dynamic and {period.static_links:,} "
        "static links"
    ]
    for table in (
        links_table(period.links),
        authorities_table(period.authorities),
        pairs_table(period.pairs),
    ):
        if table[1]:
            lines += ["", *output.table(*table)] if lines[1:] else output.table(*table)
    return "\n".join(lines)


def links_table(links: Sequence[LinkRate]) -> output.Table:
    """The links, for `output.table`."""
    rows = [
        (
            printable(f"{link.parent} -> {link.frame}"),
            f"{link.commits_per_s:.1f}",
            output.figure(link.rate_hz, 1),
            output.figure(link.least_age_s, 3),
            output.figure(link.greatest_age_s, 3),
            printable(link.authority),
            "stopped" if link.stopped else "",
        )
        for link in links
    ]
    titles = ("link", "writes/s", "rate [Hz]", "least age [s]", "greatest [s]", "authority", "")
    return titles, rows, (0, 5, 6)


def authorities_table(authorities: Sequence[AuthorityRate]) -> output.Table:
    """The authorities, for `output.table`."""
    rows = [
        (
            printable(each.authority),
            f"{each.commits_per_s:.1f}",
            f"{each.transforms_per_s:.1f}",
            f"{each.dropped:,}",
            f"{each.refused:,}",
            output.figure(each.lead_max_s, 3),
        )
        for each in authorities
    ]
    titles = ("authority", "commits/s", "transforms/s", "dropped", "refused", "lead [s]")
    return titles, rows, (0,)


def pairs_table(pairs: Sequence[PairDelay]) -> output.Table:
    """The delays of pairs, for `output.table`."""
    rows = [
        (
            printable(f"{pair.target} <- {pair.source}"),
            output.figure(pair.least_delay_s, 3),
            output.figure(pair.greatest_delay_s, 3),
            printable(pair.oldest_link or pair.problem or ""),
        )
        for pair in pairs
    ]
    return ("pair", "least delay [s]", "greatest [s]", "oldest link"), rows, (0, 3)
