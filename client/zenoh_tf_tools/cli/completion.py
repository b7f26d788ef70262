"""``zenoh-tf completion``: a script that completes commands, options and frames in a shell."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Final

from zenoh_tf import TransformException
from zenoh_tf_tools.cli.arguments import Commands
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.errors import CommandError, extra

#: How long a shell waits for the names of the frames.
_TIMEOUT_S: Final = 0.5
#: Names that no shell would read as anything else.
_PLAIN_NAME: Final = re.compile(r"[\w./+-]+")
#: The arguments that are names of frames, by what the help calls them.
_FRAMES: Final = {"FRAME", "TARGET", "SOURCE", "PARENT", "CHILD", "TRACKING", "OBSERVATION"}
#: Commands whose frames are those of a recording.
_WITHOUT_SERVER: Final = {"query"}

_BASH: Final = """\
_zenoh_tf_frames() {
  local name
  while IFS= read -r name; do
    [[ $name == "$1"* ]] && printf '%s\\n' "$name"
  done < <("${COMP_WORDS[0]}" completion frames --line "$COMP_LINE" 2>/dev/null)
}
_zenoh_tf_file_or_frame() {
  _zenoh_tf_frames "$1"
  compgen -f -- "$1"
}"""
_ZSH: Final = """\
_zenoh_tf_frames() {
  compadd -- ${(f)"$(_call_program frames zenoh-tf completion frames --line ${(qq)BUFFER})"}
}
_zenoh_tf_file_or_frame() {
  _zenoh_tf_frames
  _files
}"""
_COMPLETE: Final = {
    "bash": "_zenoh_tf_frames",
    "zsh": "_zenoh_tf_frames",
    "tcsh": "`zenoh-tf completion frames`",
}
#: Of an argument that is a recording if it is given, and else the first frame.
_COMPLETE_FILE: Final = {
    "bash": "_zenoh_tf_file_or_frame",
    "zsh": "_zenoh_tf_file_or_frame",
    "tcsh": "f",
}


def add(commands: Commands, whole: Callable[[], argparse.ArgumentParser]) -> None:
    """Add the command. `whole` makes the parser of all commands."""
    (common,) = commands.parents

    def run(args: argparse.Namespace) -> int:
        if args.shell == "frames":
            return _print_frames(args, common)
        with extra("completion", "shtab"):
            import shtab  # noqa: PLC0415 - an optional extra
        parser = whole()
        for action in _actions(parser):
            names = action.metavar if isinstance(action.metavar, tuple) else (action.metavar,)
            if _FRAMES.intersection(names):
                action.complete = _COMPLETE  # type: ignore[attr-defined]
            elif action.metavar == "FILE" and action.nargs == "?":
                action.complete = _COMPLETE_FILE  # type: ignore[attr-defined]
        preamble: Any = {"bash": _BASH, "zsh": _ZSH}  # its type says text
        print(shtab.complete(parser, args.shell, preamble=preamble))
        return 0

    completion = commands.add(
        "completion",
        run,
        "print a script that completes commands, options and frames in a shell",
        "Print a script for a shell that completes the commands and options of zenoh-tf, and the "
        "names of frames: it asks the server for them, which --connect or the environment names, "
        f"and waits {_TIMEOUT_S * 1000:g} ms at most. Needs the extra zenoh-tf[completion].\n\n"
        "The script calls `completion frames`, which prints the names. Without a server it prints "
        "nothing.",
        'eval "$(zenoh-tf completion bash)"      # in ~/.bashrc',
        "zenoh-tf completion zsh > ~/.zfunc/_zenoh-tf",
    )
    completion.add_argument("shell", choices=("bash", "zsh", "tcsh", "frames"))
    completion.add_argument(
        "--line",
        metavar="TEXT",
        default="",
        help="with frames: the line that is completed, whose --connect and --tree count",
    )


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """The arguments of all commands that ask a server."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            choices: dict[str, Any] = dict(action.choices)
            for name, child in choices.items():
                if name not in _WITHOUT_SERVER:
                    yield from _actions(child)
        else:
            yield action


def _print_frames(args: argparse.Namespace, common: argparse.ArgumentParser) -> int:
    """Print the names of the frames. Whatever goes wrong, a shell gets no names and no error."""
    try:
        words = shlex.split(args.line)
    except ValueError:  # a quote that is not closed yet
        words = args.line.split()
    with suppress(TransformException, CommandError, SystemExit, OSError):
        common.parse_known_args(words, args)
        args.timeout = _TIMEOUT_S
        with connect(args) as tf:
            names = sorted(filter(_PLAIN_NAME.fullmatch, tf.frames()))
        print(*names, sep="\n", end="\n" if names else "")
    return 0
