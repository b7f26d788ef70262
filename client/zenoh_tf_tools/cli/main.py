"""Entry point of ``zenoh-tf``: parses arguments, runs a command, reports errors.

Exit codes: 0 done, 1 rejected or failed, 2 wrong usage, 3 a fault was found. An error is one line
on stderr, with ``--json`` a JSON object. Ctrl-C ends the process by its signal.
"""

from __future__ import annotations

import argparse
import errno
import io
import os
import re
import signal
import sys
from collections.abc import Sequence
from decimal import Decimal
from importlib.metadata import version
from typing import NoReturn

from zenoh_tf import TooUncertain, TransformException
from zenoh_tf.recordings import RecordingError
from zenoh_tf.text.time_flags import duration
from zenoh_tf_client.session import environment
from zenoh_tf_client.session.connection import DEFAULT_ENDPOINT, DEFAULT_TIMEOUT_S, DEFAULT_TREE
from zenoh_tf_tools.cli import completion, output
from zenoh_tf_tools.cli.arguments import Commands
from zenoh_tf_tools.cli.connection import add_credentials
from zenoh_tf_tools.cli.recordings import query, record, replay
from zenoh_tf_tools.cli.setup import calibration, urdf
from zenoh_tf_tools.cli.show import foxglove, monitor, plot, rerun, top
from zenoh_tf_tools.cli.show import view as viewer
from zenoh_tf_tools.cli.tree import (
    doctor,
    estimate,
    explain,
    follow,
    inspect,
    lookups,
    static,
    write,
)
from zenoh_tf_tools.cli.usage import JsonUsageParser, UsageParser
from zenoh_tf_tools.errors import FAULT_FOUND, CommandError

# argparse reads "-1e-3" and "-5." as options, but "-0.001" as a number.
_NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
# So it does an angle such as "-90deg", unless there is a space in it.
_NEGATIVE_ANGLE = re.compile(rf"{_NEGATIVE_NUMBER.pattern}(deg|rad)")
# argparse reads a time such as "-1s" as an option, too.
_NEGATIVE_TIME = re.compile(r"-\.?\d[\w.]*")

_EPILOG = """\
values:     DURATION 20ms, 2s or 5min; TIME 2026-01-31T12:00:00Z, 1700000000.5s or now-2s,
            in a recording +10s (after its first stamp) or -2s (before its last one);
            docs/reference/commands.md has the grammar
exit codes: 0 done, 1 rejected or failed, 2 wrong usage, 3 the command has found what is wrong
            (doctor: a fault; explain: why the lookup fails; estimate: too uncertain)
errors:     one line on stderr; with --json a JSON object there, with the keys
            "type", "message" and "fields" (the fields of the exception)
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; ``argv`` defaults to the process's arguments. Returns the exit code."""
    given = sys.argv[1:] if argv is None else list(argv)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Names may have characters that the terminal's encoding lacks.
        sys.stdout.reconfigure(errors="backslashreplace")
    parser = _parser(json_errors="--json" in given)
    if not given:
        parser.print_help(sys.stderr)
        return 2
    args, unknown = parser.parse_known_args(_for_argparse(given))
    if unknown:  # of the command: the parser above would show its own usage
        args.usage_error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        code: int = args.run(args)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr, flush=True)
        # Shells expect that an interrupted command is ended by the signal. An ordinary exit
        # would also wait for a session that is still being opened.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
        return 130
    except BrokenPipeError:
        # The reader of the output went away (`| head`). What is still buffered is discarded,
        # or Python would report an error at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        text = f"cannot write the output: {error.strerror}"
        output.print_error("CommandError", text, {}, as_json=args.json, shown=text)
        return 1
    except TransformException as error:
        notes = "".join(f"; {note}" for note in getattr(error, "__notes__", ()))
        name, message = type(error).__name__, f"{error}{notes}"
        shown = f"{name}: {message}"
        output.print_error(name, message, error.facts, as_json=args.json, shown=shown)
        return FAULT_FOUND if isinstance(error, TooUncertain) else 1
    except (CommandError, RecordingError) as error:
        text = str(error)
        output.print_error("CommandError", text, {}, as_json=args.json, shown=text)
        return 1


def run() -> NoReturn:
    """Run ``main`` and end the process with its exit code."""
    sys.exit(main())


def _for_argparse(given: Sequence[str]) -> list[str]:
    """Rewrite negative numbers, times and angles so that argparse does not read them as options."""
    arguments: list[str] = []
    for argument in given:
        if _NEGATIVE_NUMBER.fullmatch(argument):
            arguments.append(format(Decimal(argument), "f"))
        elif _NEGATIVE_ANGLE.fullmatch(argument):
            arguments.append(f" {argument}")
        elif _NEGATIVE_TIME.fullmatch(argument) and arguments and arguments[-1].startswith("--"):
            arguments[-1] += f"={argument}"
        else:
            arguments.append(argument)
    return arguments


def _parser(json_errors: bool = False) -> argparse.ArgumentParser:
    kind = JsonUsageParser if json_errors else UsageParser
    parser = kind(
        prog="zenoh-tf",
        description="Query, change and watch a transform tree served over Zenoh.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {version('zenoh-tf')}")
    _add_common(parser, top=True)
    common = argparse.ArgumentParser(add_help=False)
    _add_common(common, top=False)
    parsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    commands = Commands(parsers, common)
    families = [lookups, estimate, explain, follow, doctor, inspect, monitor, top, viewer]
    families += [foxglove, rerun, plot, write, static, urdf, calibration, query, record, replay]
    for family in families:
        family.add(commands)
    completion.add(commands, _parser)
    return parser


def _add_common(parser: argparse.ArgumentParser, *, top: bool) -> None:
    """Add the options that may stand before the command or after it."""

    def default(value: object) -> object:
        # A default after the command would overwrite an option given before it.
        return value if top else argparse.SUPPRESS

    group = parser.add_argument_group("connection and output")
    group.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        default=default(None),
        help="where the server listens; several, with commas between or the option repeated: the "
        "first that answers, now and later (default: the environment's "
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
        metavar="DURATION",
        type=duration(above=True),
        default=default(DEFAULT_TIMEOUT_S),
        help="how long to wait for the connection and for each reply "
        f"(default {DEFAULT_TIMEOUT_S:g}s)",
    )
    group.add_argument(
        "--json",
        action="store_true",
        default=default(False),
        help="print one JSON document; an error is one JSON object on stderr",
    )
    add_credentials(parser, default(None), shown=top)


if __name__ == "__main__":
    run()
