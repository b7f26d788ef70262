"""``zenoh-tf completion``: a script that completes commands and options in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from zenoh_tf_tools.cli.types import Commands, examples
from zenoh_tf_tools.errors import CommandError


def add(commands: Commands, whole: Callable[[], argparse.ArgumentParser]) -> None:
    """Add the command. `whole` makes the parser of all commands."""
    completion = commands.add_parser(
        "completion",
        help="print a script that completes commands and options in a shell",
        description="Print a script for a shell that completes the commands and options of "
        "zenoh-tf. Needs the extra zenoh-tf[completion].",
        **examples(
            'eval "$(zenoh-tf completion bash)"      # in ~/.bashrc',
            "zenoh-tf completion zsh > ~/.zfunc/_zenoh-tf",
        ),
    )
    completion.add_argument("shell", choices=("bash", "zsh", "tcsh"))
    completion.set_defaults(run=lambda args: _completion(args, whole()))


def _completion(args: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    try:
        import shtab  # noqa: PLC0415 - an optional extra
    except ModuleNotFoundError as error:
        raise CommandError(
            "completion scripts are made by shtab, which is not installed; install it with: "
            'pip install "zenoh-tf[completion]"'
        ) from error
    print(shtab.complete(parser, args.shell))
    return 0
