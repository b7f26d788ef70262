"""``zenoh-tf monitor``: rates, delays and ages, period by period."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import asdict

from zenoh_tf import ServerUnavailable
from zenoh_tf.text import printable
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import Commands, add_periods
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.quit_key import ends_on_q
from zenoh_tf_tools.cli.show.pair_delays import add_pairs
from zenoh_tf_tools.cli.show.rates import Period, watch


def add(commands: Commands) -> None:
    monitor = commands.add(
        "monitor",
        _monitor,
        "print the rates and delays of links and publishers, again and again",
        "Print for each period the links and the authorities: how often a link was written in it, "
        "the rate of its history, the least and the greatest age of its newest stamp (the least is "
        "about its delay); for an authority its commits and transforms, what was dropped and "
        "refused, and by how much its stamps lead their arrival. --json prints one document per "
        "line. Continues if the server ends and comes back; q or Ctrl-C ends it.",
        "zenoh-tf monitor",
        "zenoh-tf monitor --pair map gripper --pair map camera",
        "zenoh-tf monitor --every 500ms --count 2 --json",
    )
    add_periods(monitor, 2)
    add_pairs(monitor)


def _monitor(args: argparse.Namespace) -> int:
    with connect(args) as tf, ends_on_q():
        printed, is_reported = 0, False
        while printed != args.count:
            try:
                period = watch(tf, args.every, args.pairs)
            except ServerUnavailable as error:
                if not is_reported:
                    output.report_waiting(error, args.json)
                is_reported = True
                time.sleep(args.every)
                continue
            is_reported = False
            if args.json:
                output.print_json({"tree": args.tree, **asdict(period)})
            else:
                print(f"\n{text(period)}" if printed else text(period))
            sys.stdout.flush()
            printed += 1
    return 0


def text(period: Period) -> str:
    """A period as tables."""
    links = [
        (
            f"{printable(link.parent)} -> {printable(link.frame)}",
            f"{link.commits_per_s:.1f}",
            output.figure(link.rate_hz, 1),
            output.figure(link.least_age_s, 3),
            output.figure(link.greatest_age_s, 3),
            printable(link.authority),
            "stopped" if link.stopped else "",
        )
        for link in period.links
    ]
    authorities = [
        (
            printable(each.authority),
            f"{each.commits_per_s:.1f}",
            f"{each.transforms_per_s:.1f}",
            f"{each.dropped:,}",
            f"{each.refused:,}",
            output.figure(each.lead_max_s, 3),
        )
        for each in period.authorities
    ]
    lines = [
        f"in {period.seconds:.1f} s: {len(links):,} dynamic and {period.static_links:,} static "
        "links"
    ]
    if links:
        titles = ("link", "writes/s", "rate [Hz]", "least age [s]", "greatest [s]", "authority", "")
        lines += output.table(titles, links, texts=(0, 5, 6))
    if authorities:
        lines.append("")
        columns = ("authority", "commits/s", "transforms/s", "dropped", "refused", "lead [s]")
        lines += output.table(columns, authorities, texts=(0,))
    if period.pairs:
        delays = [
            (
                f"{printable(pair.target)} <- {printable(pair.source)}",
                output.figure(pair.least_delay_s, 3),
                output.figure(pair.greatest_delay_s, 3),
                printable(pair.oldest_link or pair.problem or ""),
            )
            for pair in period.pairs
        ]
        of_pairs = ("pair", "least delay [s]", "greatest [s]", "oldest link")
        lines += ["", *output.table(of_pairs, delays, texts=(0, 3))]
    return "\n".join(lines)
