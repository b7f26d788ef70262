"""Entry point of ``zenoh-tf``: arguments in, exit code out.

Exit codes: 0 done, 1 refused or failed (one line on stderr), 2 wrong usage.
Ctrl-C ends the process by its signal.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import signal
import sys
from collections.abc import Sequence
from decimal import Decimal
from importlib.metadata import version
from typing import NoReturn

from zenoh_tf import (
    BackwardExtrapolationException,
    ForwardExtrapolationException,
    TransformException,
)
from zenoh_tf.export import printable
from zenoh_tf_client import environment
from zenoh_tf_client.cli import query, replay, stamps, view, write
from zenoh_tf_client.cli.errors import CommandError
from zenoh_tf_client.client import DEFAULT_ENDPOINT, DEFAULT_TIMEOUT_S, DEFAULT_TREE

# argparse takes "-1e-3" and "-5." for options; "-0.001" it knows to be a number.
_NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; ``argv`` defaults to the process's arguments. Returns the exit code."""
    given = sys.argv[1:] if argv is None else list(argv)
    args = _parser().parse_args([_plain_number(arg) for arg in given])
    try:
        code: int = args.run(args)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr, flush=True)
        # Ended by the signal itself, as shells expect of a command that was interrupted; and
        # an ordinary exit would wait for a session that is still being opened.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
        return 130
    except BrokenPipeError:
        # The reader of our output went away (`| head`). Python would complain at exit about
        # what is still buffered, so that goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except TransformException as error:
        return _fail(f"{type(error).__name__}: {error}{_distance(error)}")
    except CommandError as error:
        return _fail(str(error))


def run() -> NoReturn:
    """The process: ``main()``, and it is over.

    Not by way of taking the interpreter down: a thread of Zenoh's that wants it at that moment
    aborts the process, and the exit code would be that of a crash.
    """
    code = main()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)


def _fail(message: str) -> int:
    print("zenoh-tf: " + printable(" ".join(message.split())), file=sys.stderr)
    return 1


def _distance(error: TransformException) -> str:
    """How far beyond the data a time is; the message has both ends in nanoseconds."""
    if error.stamp_ns is None:
        return ""
    if isinstance(error, ForwardExtrapolationException) and error.newest_stamp_ns is not None:
        return f" ({stamps.age(error.stamp_ns - error.newest_stamp_ns)} too late)"
    if isinstance(error, BackwardExtrapolationException) and error.oldest_stamp_ns is not None:
        return f" ({stamps.age(error.oldest_stamp_ns - error.stamp_ns)} too early)"
    return ""


def _plain_number(arg: str) -> str:
    return format(Decimal(arg), "f") if _NEGATIVE_NUMBER.fullmatch(arg) else arg


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="zenoh-tf", description="Ask, change and watch a transform tree served over Zenoh."
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {version('zenoh-tf')}")
    _add_common(parser, top=True)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    common = argparse.ArgumentParser(add_help=False)
    _add_common(common, top=False)
    for family in (query, view, write, replay):
        family.add(commands, common)
    return parser


def _add_common(parser: argparse.ArgumentParser, *, top: bool) -> None:
    """The options that stand before the command or behind it."""

    def default(value: object) -> object:
        # Behind the command nothing is a default, or it would undo what stood before it.
        return value if top else argparse.SUPPRESS

    group = parser.add_argument_group("connection and output")
    group.add_argument(
        "--connect",
        metavar="ENDPOINT",
        default=default(environment.endpoint()),
        help="where the server listens (default: the environment's "
        f"{environment.ENDPOINT_VARIABLE}, else {DEFAULT_ENDPOINT})",
    )
    group.add_argument(
        "--tree",
        metavar="NAME",
        default=default(environment.tree()),
        help="the tree's name (default: the environment's "
        f"{environment.TREE_VARIABLE}, else {DEFAULT_TREE})",
    )
    group.add_argument(
        "--timeout",
        metavar="S",
        type=_positive_seconds,
        default=default(DEFAULT_TIMEOUT_S),
        help="seconds to wait for the connection, and for each answer "
        f"(default {DEFAULT_TIMEOUT_S:g})",
    )
    group.add_argument(
        "--json", action="store_true", default=default(False), help="print one JSON document"
    )


def _positive_seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 0.0 < seconds < 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of seconds")
    return seconds


if __name__ == "__main__":
    run()
