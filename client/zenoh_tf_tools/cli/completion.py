"""``zenoh-tf completion``: a script that completes commands and options in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from zenoh_tf_tools.cli.arguments import Commands
from zenoh_tf_tools.errors import extra


def add(commands: Commands, whole: Callable[[], argparse.ArgumentParser]) -> None:
    """Add the command. `whole` makes the parser of all commands."""

    def run(args: argparse.Namespace) -> int:
        with extra("completion", "shtab"):
            import shtab  # noqa: PLC0415 - an optional extra
        print(shtab.complete(whole(), args.shell))
        return 0

    completion = commands.add(
        "completion",
        run,
        "print a script that completes commands and options in a shell",
        "Print a script for a shell that completes the commands and options of zenoh-tf. Needs the "
        "extra zenoh-tf[completion].",
        'eval "$(zenoh-tf completion bash)"      # in ~/.bashrc',
        "zenoh-tf completion zsh > ~/.zfunc/_zenoh-tf",
    )
    completion.add_argument("shell", choices=("bash", "zsh", "tcsh"))
