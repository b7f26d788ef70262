"""What the declarations of the commands share: how one is added, and arguments of several."""

from __future__ import annotations

import argparse
import shutil
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

from zenoh_tf.text.flag_values import number, whole
from zenoh_tf.text.time_flags import LIVE_TIMES, MAX_DURATION_S, duration, live_time


class Commands:
    """Commands, or the actions of one.

    `parents`: the parsers of the options that each has.
    """

    def __init__(self, parsers: Any, *parents: argparse.ArgumentParser) -> None:
        self.parents = parents
        self.parsers = parsers

    def add(
        self,
        name: str,
        run: Callable[[argparse.Namespace], int] | None,
        help_: str,
        description: str,
        *examples: str,
    ) -> argparse.ArgumentParser:
        """Add a command that `run` runs; None for one that has actions in its place.

        `examples` are command lines for the end of its help.
        """
        width = min(79, shutil.get_terminal_size().columns - 2)
        paragraphs = [textwrap.fill(each, width) for each in description.split("\n\n")]
        parser: argparse.ArgumentParser = self.parsers.add_parser(
            name,
            parents=self.parents if run else (),
            help=help_,
            description="\n\n".join(paragraphs),
            epilog="\n".join(["examples:", *(f"  {line}" for line in examples)]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        parser.set_defaults(run=run, usage_error=parser.error)
        return parser


def add_frames(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("target", metavar="TARGET", help="the frame to express the pose in")
    parser.add_argument("source", metavar="SOURCE", help="the frame whose pose is asked for")


def add_live_at(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--at", metavar="TIME", type=live_time, help=LIVE_TIMES)


def add_max_gap(parser: argparse.ArgumentParser) -> None:
    add_duration(
        parser,
        "--max-gap",
        "refuse to interpolate between samples that are farther apart, such as 200ms",
    )


def add_authority(parser: argparse.ArgumentParser, default: str) -> None:
    parser.add_argument(
        "--authority",
        metavar="NAME",
        default=default,
        help=f"name to publish as (default {default})",
    )


def add_duration(
    parser: argparse._ActionsContainer,
    option: str,
    help_: str,
    default_s: float | None = None,
    *,
    low_s: float = 0.0,
    high_s: float = MAX_DURATION_S,
    above: bool = False,
) -> None:
    """Add a length of time, in seconds as `option`_s: at least `low_s`, or `above` it."""
    parser.add_argument(
        option,
        dest=f"{option.lstrip('-').replace('-', '_')}_s",
        metavar="DURATION",
        type=duration(low_s, high_s, above=above),
        default=default_s,
        help=help_,
    )


def add_periods(parser: argparse.ArgumentParser, default_s: int) -> None:
    """Add the length and the number of the periods in which a tree is watched."""
    add_duration(parser, "--every", f"the period (default {default_s}s)", default_s, above=True)
    parser.add_argument("--count", metavar="N", type=whole(1), help="end after so many periods")


def add_listen(parser: argparse.ArgumentParser, port: int, note: str) -> None:
    """Add the address and the port that a command listens on, with a note about the port."""
    parser.add_argument(
        "--host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="address to listen on (default 127.0.0.1: only this machine)",
    )
    parser.add_argument(
        "--port",
        metavar="N",
        type=whole(1, 65_535),
        default=port,
        help=f"port to listen on (default {port}; {note})",
    )


def add_scene(
    parser: argparse.ArgumentParser, axes_m: float | None, axes_default: str = ""
) -> None:
    """Add what is drawn of a tree: the frame that stands still, the axes, the shapes of robots."""
    parser.add_argument(
        "--fixed",
        metavar="FRAME",
        help="the frame that stands still (default: the root of most frames)",
    )
    parser.add_argument(
        "--axes",
        metavar="M",
        type=number(0.001, 1e6),
        default=axes_m,
        help=f"length of the frames' axes in metres (default: {axes_default or axes_m})",
    )
    parser.add_argument(
        "--urdf",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="draw the shapes of this robot at the frames of its links, whatever prefix they "
        "have; may be given several times",
    )
